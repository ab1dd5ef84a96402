"""A composition root: the stack with the simulated grabbing cell, `python -m rtstack.live [PORT [LOGS]]`."""

import sys
from pathlib import Path

from hal.cell import Cell
from rtstack.live.source import CellObject, CellSource, Fixture
from rtstack.live.stack import StackSettings, run_stack

SIMULATED_SOURCE = "rtstack.live.__main__:simulated_source"


def simulated_source(_description: Path | None) -> CellSource:
    """Return the simulated cell, in real time, as a source."""
    from sim_robot.cell import RealtimeClock, simulated_cell
    from sim_robot.scene import load_scene

    scene = load_scene()
    (x, y), (length, width), top = scene.table.centre_xy, scene.table.size_xy, scene.table.top_z

    def open_cell(object_name: str, displacement_m: float, seed: int) -> Cell:
        return simulated_cell(object_name, displacement_m, seed, clock=RealtimeClock())

    return CellSource(
        name=scene.name,
        simulated=True,
        objects=tuple(CellObject(name, thing.size) for name, thing in scene.objects.items()),
        fixtures=(Fixture("table", (x, y, top / 2.0), (length, width, top)),),
        open_cell=open_cell,
    )


if __name__ == "__main__":
    port = int(sys.argv[1]) if len(sys.argv) > 1 else 8080
    logs = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("logs")
    sys.exit(run_stack(StackSettings(port=port, logs=logs, source=SIMULATED_SOURCE)))
