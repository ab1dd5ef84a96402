"""Where the robot process gets its cell from: a kind of cell, with the description that a person is shown."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from hal.cell import Cell
from hal.displacement import Displacement
from rtstack.cells import kind_of, load_description, open_cell
from rtstack.cells.commissioning import commissioned
from rtstack.model.cell_description import CellDescription
from rtstack.trials.errors import TrialError


@dataclass(frozen=True, slots=True)
class CellSource:
    """A kind of cell (as the command line spells it), its description and that file, and what it said when it was read.

    open_cell: with an object in it ("": none), displaced from its place, a seed, and a script of faults for a simulated
    robot. Each call gives a fresh cell; the caller closes it. Raises HardwareError with one line.
    """

    kind: str
    description: CellDescription
    file: Path
    open_cell: Callable[[str, Displacement, int, Path | None], Cell]
    content: bytes

    def check(self) -> None:
        """Raise TrialError where the file was changed since it was read: a calibration, or a person."""
        if self.file.read_bytes() != self.content:
            raise TrialError(f"{self.file} was changed since the stack was started: end it and start it again")


def described_as(file: Path, kind: str) -> CellDescription:
    """Return what a file says of a cell of this kind. Raises ConfigurationError, TrialError for what it refuses."""
    description, _ = load_description(file, kind)
    found, argument = kind_of(kind)
    found.check(argument, description, file)
    found.measured(argument, description, file)
    description = commissioned(kind, description, file)
    return replace(description, simulated=found.simulated(argument, description))


def live_source(file: Path, kind: str = "direct") -> CellSource:
    """Return the cell that a person watches, paced if it is simulated. Raises ConfigurationError, TrialError."""
    description, content = described_as(file, kind), file.read_bytes()

    def open_live(object_name: str, displacement: Displacement, seed: int, faults: Path | None) -> Cell:
        return open_cell(kind, object_name, displacement, seed, description, faults, cell_file=file, live=True)

    return CellSource(kind=kind, description=description, file=file, open_cell=open_live, content=content)
