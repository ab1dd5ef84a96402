"""A child process watches its parent: its standard input is a pipe that the supervisor holds."""

import os
import sys
import threading
from collections.abc import Callable


def watch_parent(when_cut: Callable[[], None]) -> None:
    """Call `when_cut` once, from a side thread, when the supervisor's end of the pipe closes, however it ended."""

    def wait() -> None:
        while os.read(descriptor, 1024):
            pass
        when_cut()

    descriptor = sys.stdin.fileno()
    threading.Thread(target=wait, daemon=True, name="parent watch").start()
