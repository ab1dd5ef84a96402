"""A child process watches its parent: its standard input is a pipe that the supervisor holds."""

import os
import sys
import threading
from collections.abc import Callable


def watch_parent(when_cut: Callable[[], None], told: Callable[[str], None] = lambda _: None) -> None:
    """Call `when_cut` once, from a side thread, when the supervisor's end of the pipe closes, however it ended.

    told: called with each line that the supervisor writes.
    """

    def wait() -> None:
        while line := os.read(descriptor, 1024):
            told(line.decode().strip())
        when_cut()

    descriptor = sys.stdin.fileno()
    threading.Thread(target=wait, daemon=True, name="parent watch").start()
