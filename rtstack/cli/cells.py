"""Opens a cell by its address. The only module of rtstack that names the simulated robot."""

from importlib.resources import as_file, files
from pathlib import Path

from hal.cell import Cell
from rtstack.live.source import CellSource
from rtstack.model.cell_description import CellDescription, load_cell_description
from rtstack.trials.errors import TrialError

KINDS = "direct, realtime"


def default_cell_file() -> Path:
    """Return the path of the description of the simulated grabbing cell."""
    with as_file(files("deploy.cells") / "grab.toml") as path:
        return path


def load_description(path: Path | None) -> tuple[CellDescription, Path]:
    """Return the cell's description and the file that it came from. Raises ConfigurationError."""
    source = path or default_cell_file()
    return load_cell_description(source), source


def open_cell(kind: str, object_name: str, displacement_m: float, seed: int) -> Cell:
    """Open a cell with the object in its place. Raises TrialError for an unknown kind, HardwareError from the cell.

    kind: direct (one process, lockstep, deterministic) or realtime (the same plant, 1 kHz, whatever the answer takes).
    """
    if kind not in ("direct", "realtime"):
        raise TrialError(f"unknown cell {kind!r}: choose one of {KINDS}")
    from sim_robot.cell import simulated_cell
    from sim_robot.clock import RealtimeClock

    clock = RealtimeClock() if kind == "realtime" else None
    return simulated_cell(object_name, displacement_m, seed, clock=clock).as_cell(kind)


def live_source(description: Path) -> CellSource:
    """Return the simulated cell that a person watches, for the robot process. Raises ConfigurationError.

    It is the direct cell, paced: real time where the machine can, slower where it cannot, and never wrong.
    """

    def open_live(object_name: str, displacement_m: float, seed: int) -> Cell:
        from sim_robot.cell import simulated_cell
        from sim_robot.clock import PacedLockstep

        return simulated_cell(object_name, displacement_m, seed, clock=PacedLockstep()).as_cell("direct")

    return CellSource(
        kind="direct", description=load_cell_description(description), file=description, open_cell=open_live
    )
