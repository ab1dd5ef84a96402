"""Where a campaign's cases run on arms: a cell that stays open, and a person who watches."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

from hal.cell import Cell
from rtstack.trials.carry_out import Host, PreparedRun


class CellHost(Host, Protocol):
    """A host of runs whose cell stays open, and whose motion a person has allowed for all of them.

    record: the metadata record `campaign` of the next log; log_path: of the next log, None for none.
    """

    record: Mapping[str, str] | None
    log_path: Path | None

    @property
    def stopped(self) -> bool:
        """Whether the person has asked for a stop."""
        ...

    @property
    def paused(self) -> str:
        """Why no further run is to begin for now, and what the person does to go on; "" where one may."""
        ...

    def look(self, reason: str) -> None:
        """Pause until the person, where there is one, has looked at the cell: a run has ended with a fault."""
        ...

    def kept_cell(self, run: PreparedRun[Any]) -> AbstractContextManager[Cell]:
        """Give the cell, open for all runs. Raises HardwareError, TrialError."""
        ...

    def watched(self) -> AbstractContextManager[Any]:
        """Have a person, who watches, allow the motion of all runs. Raises TrialError."""
        ...
