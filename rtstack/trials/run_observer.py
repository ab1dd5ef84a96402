"""The observer of a run: it gives events for the run's log and receives the end of its session."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from rtstack.loop.end import End
from rtstack.samples import Level


@dataclass(frozen=True, slots=True)
class RunEvent:
    """An event that came from outside of the loop: its level, its source, one line of text."""

    level: Level
    name: str
    text: str


class RunObserver(Protocol):
    """Called between ticks and at the end; never waits or raises."""

    def run_events(self) -> Iterable[RunEvent]:
        """Return the events since the last call, oldest first."""
        ...

    def ended(self, end: End, detail: str) -> None:
        """Receive how the session ended, once both arms are at rest."""
        ...
