"""Where a campaign's cases run on arms: a cell that stays open, and a person who watches."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

from hal.cell import Cell
from rtstack.trials.carry_out import PreparedRun


class CellHost(Protocol):
    """A host of a campaign's runs, whose motion a person has allowed for all of them.

    sets_object: opening the cell for a run puts the object in its place, so that no arm has to.
    """

    sets_object: bool

    @property
    def has_person(self) -> bool:
        """Whether a person watches: not simulated arms."""
        ...

    @property
    def stopped(self) -> str:
        """Why no further run may begin, "" where one may: a person has asked for a stop, or has taken over."""
        ...

    @property
    def paused(self) -> str:
        """Why no further run is to begin for now, and what the person does to go on; "" where one may."""
        ...

    def look(self, reason: str) -> None:
        """Pause until the person, where there is one, has looked at the cell: a run has ended with a fault."""

    def ask(self, what: str) -> None:
        """Pause until a person has set up what they are asked for. Raises TrialError where there is no person."""

    def kept_cell(self, run: PreparedRun[Any]) -> AbstractContextManager[Cell]:
        """Give the cell to look at, its states and the tracker's poses. Raises HardwareError, TrialError."""
        ...

    def put_back(self) -> Cell | None:
        """Have the object of a simulated robot at its first place; return the cell, opened again. None: a person does.

        Raises HardwareError.
        """

    def watched(self) -> AbstractContextManager[Any]:
        """Have a person, who watches, allow the motion of all runs. Raises TrialError."""
        ...

    def carry_out(self, run: PreparedRun[Any], log: Path, record: Mapping[str, str] = {}) -> Any:
        """Carry out a run and return its result. record: what its log says of the campaign, empty for nothing.

        Raises TrialError, LogError, HardwareError; then no arm has moved.
        """
        ...

    def recover(self) -> Cell | None:
        """Clear what the arms have latched; return the cell where it was opened again, because they were lost.

        Raises TrialError where its cause persists or a person has to act.
        """
