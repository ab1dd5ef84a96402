"""Ctrl-C, or a terminal that is closed, asks for a controlled stop; a second Ctrl-C ends the program at once."""

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


class Interrupt:
    """A stop signal of the loop that Ctrl-C, SIGTERM and SIGHUP raise."""

    def __init__(self) -> None:
        self.stop_requested = False

    @property
    def asked(self) -> bool:
        """See rtstack.trials.run_context.SoftStop: the first Ctrl-C brakes along the path."""
        return self.stop_requested

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle the signal."""
        if number == signal.SIGHUP:
            nowhere = os.open(os.devnull, os.O_RDWR)
            for descriptor in (1, 2):
                os.dup2(nowhere, descriptor)
        elif self.stop_requested:
            raise KeyboardInterrupt
        self.stop_requested = True


@contextmanager
def interruptible() -> Iterator[Interrupt]:
    """Catch Ctrl-C, SIGTERM and SIGHUP for the time of a run."""
    with handled(interrupt := Interrupt()):
        yield interrupt


@contextmanager
def handled(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Handle Ctrl-C, SIGTERM and SIGHUP."""
    previous = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, former in previous.items():
            signal.signal(number, former)
