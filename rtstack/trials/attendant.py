"""Who has a run carried out: what is said meanwhile belongs into its log, and how its session ended has to be known."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from rtstack.loop.end import End
from rtstack.samples import Level


@dataclass(frozen=True, slots=True)
class Remark:
    """An event that came from outside of the loop: how bad it is, who says it, one line."""

    level: Level
    name: str
    text: str


class Attendant(Protocol):
    """Asked between ticks, told at the end; never waits or raises."""

    def remarks(self) -> Iterable[Remark]:
        """Return what was said since the last call, oldest first."""
        ...

    def ended(self, end: End, detail: str) -> None:
        """Learn how the session ended, once both arms are at rest."""
        ...
