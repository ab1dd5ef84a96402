"""Where the object is before anything moves."""

import time

from hal.cell import LEFT, RIGHT, Cell
from hal.tracker import ObjectPose
from rtstack.model.cell_description import NO_TRACKER, CellDescription

LONGEST_LOOK_S = 1.0  # a camera has 20 pictures by then, and a clock of the tracker's own is known


def object_before(cell: Cell, description: CellDescription) -> ObjectPose:
    """Return where the tracker sees the object, `seen` 0 where it does not, before the loop of an open cell runs.

    A tracker's times mean something once the arms' states have told the robot's time: they are read meanwhile, for
    LONGEST_LOOK_S at most. Raises HardwareError from the arms.
    """
    pose, link = cell.tracker.latest(), cell.link
    if link is None or not cell.own_clocks or description.tracker.kind == NO_TRACKER:
        return pose
    end_s = time.monotonic() + LONGEST_LOOK_S
    while not pose.record["seen"][0] and time.monotonic() < end_s:
        ready = link.wait()
        for side, arm in ((LEFT, cell.left), (RIGHT, cell.right)):
            if ready & side:
                arm.read()
        pose = cell.tracker.latest()
    return pose
