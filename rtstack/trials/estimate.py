"""What the robots estimate as force while nothing touches the pads: the offset that a detector has to cope with.

On metal it reads 2 N without a tool, changes with the pose, and grows by 9.8 N with each kg that the payload is off.
"""

import numpy as np
from numpy.typing import NDArray

from hal.cell import Cell
from rtstack.control.parameters import DetectorParameters
from rtstack.model.cell_description import CellDescription, base_frame
from rtstack.trials.errors import TrialError

LOOKS = 50  # states: 50 ms
# of the largest tare: what is left is for how much the offset changes on the way from here to the object
REST_SHARE = 0.75


def resting_force(cell: Cell, description: CellDescription) -> NDArray[np.float64]:
    """Return the mean force (arms, 3) of each pad on their surroundings along the world's axes, N. Raises
    HardwareError."""
    forces = np.zeros((len(cell.arms), 3))
    for _ in range(LOOKS):
        for side, arm in enumerate(cell.arms):
            forces[side] += arm.read().O_F_ext_hat_K[:3] / LOOKS
    return np.stack([
        base_frame(mounting).rotation @ force
        for mounting, force in zip(description.arms, forces, strict=True)
    ])  # fmt: skip


def check_estimate(cell: Cell, description: CellDescription, detector: DetectorParameters, detects: bool = True) -> str:
    """Look at the arms of an open cell, at rest, before a motion: return in one line what is to be known, "" for
    nothing.

    The plant in this process begins with its first tick, and is not asked. detects: an impact is to be detected.
    Raises TrialError where it cannot be, and for an arm that feels too much: with a payload that the robot was not told
    of it sinks as soon as its torque is ours. HardwareError from the arms.
    """
    if cell.link is None:
        return ""
    said = []
    largest = REST_SHARE * detector.largest_tare_n
    for side, force in zip(cell.sides, resting_force(cell, description), strict=True):
        size = float(np.linalg.norm(force))
        if size == 0.0 and not detects:
            continue
        if size == 0.0:
            raise TrialError(
                f"the {side} arm estimates no force at all (O_F_ext_hat_K is zero): no impact would be detected; "
                "play, by hand and free motions need no estimate"
            )
        kg = force[2] / 9.81
        if size > largest:
            raise TrialError(
                f"the {side} arm feels {size:.1f} N with nothing at its pad, more than {largest:g} N: it would sink, "
                f"and no impact could be told from it. A payload that is off by {kg:+.2f} kg would explain "
                f"{abs(force[2]):.1f} N of it: clear the pad, then correct the tool (Desk, [pad]); rtstack check says "
                "more"
            )
        if size >= detector.tare_n:
            said.append(f"{side} {size:.1f} N (payload off by {kg:+.2f} kg?)")
    return f"the force estimate is biased at rest, and the detector counts from it: {', '.join(said)}" if said else ""
