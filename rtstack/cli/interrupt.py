"""Ctrl-C asks for a controlled stop: the arms brake, the log is finished. A second one ends the program at once."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


class Interrupt:
    """A stop signal of the loop that Ctrl-C and SIGTERM raise."""

    def __init__(self) -> None:
        self.stop_requested = False

    @property
    def asked(self) -> bool:
        """See rtstack.trials.run_context.SoftStop: the first Ctrl-C brakes along the path."""
        return self.stop_requested

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle the signal."""
        if self.stop_requested:
            raise KeyboardInterrupt
        self.stop_requested = True


@contextmanager
def interruptible() -> Iterator[Interrupt]:
    """Catch Ctrl-C and SIGTERM for the time of a run."""
    interrupt = Interrupt()
    with handled(interrupt):
        yield interrupt


@contextmanager
def handled(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Handle Ctrl-C and SIGTERM."""
    previous = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, former in previous.items():
            signal.signal(number, former)
