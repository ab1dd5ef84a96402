"""A composition root: the stack with the simulated grabbing cell, `python -m rtstack.live [PORT [LOGS]]`."""

import sys
from importlib.resources import as_file, files
from pathlib import Path

from hal.cell import Cell
from rtstack.live.pace import PacedLockstep
from rtstack.live.source import CellSource
from rtstack.live.stack import StackSettings, run_stack
from rtstack.model.cell_description import load_cell_description

KIND = "lockstep"
SIMULATED_SOURCE = "rtstack.live.__main__:simulated_source"


def simulated_source(description: Path) -> CellSource:
    """Return the simulated cell as a source: in lockstep, paced to real time. Raises ConfigurationError."""
    from sim_robot.cell import simulated_cell  # the robot process alone pays for the plant

    cell = load_cell_description(description)

    def open_cell(object_name: str, displacement_m: float, seed: int) -> Cell:
        simulated = simulated_cell(object_name, displacement_m, seed, clock=PacedLockstep())
        return simulated.as_cell(KIND)

    return CellSource(kind=KIND, description=cell, file=description, open_cell=open_cell)


if __name__ == "__main__":
    port = int(sys.argv[1]) if len(sys.argv) > 1 else 8080
    logs = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("logs")
    with as_file(files("deploy.cells") / "grab.toml") as grab:
        sys.exit(run_stack(StackSettings(port=port, logs=logs, source=SIMULATED_SOURCE, cell=grab)))
