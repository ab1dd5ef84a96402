"""The lifeline of a child process: its standard input, a pipe that the supervisor holds and never writes to."""

import os
import sys
import threading
from collections.abc import Callable


def hold_lifeline(when_cut: Callable[[], None]) -> None:
    """Call `when_cut` once, from a side thread, when the supervisor's end of the pipe closes, however it ended."""

    def wait() -> None:
        while os.read(descriptor, 1024):
            pass
        when_cut()

    descriptor = sys.stdin.fileno()
    threading.Thread(target=wait, daemon=True, name="lifeline").start()
