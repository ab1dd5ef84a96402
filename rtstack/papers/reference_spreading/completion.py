"""Full contact in a trial's log: the detector run on what was measured, whatever the controller was."""

import numpy as np

from rtstack.control.completion import CompletionDetector
from rtstack.control.parameters import CompletionParameters
from rtstack.loop.history import Columns
from rtstack.model.cell_description import CellDescription, base_frame

SLOPE = 2  # ticks on each side over which a velocity is taken: 2 mm/s of the encoders' noise are left


def contact_completed(
    columns: Columns, description: CellDescription, first: int, patience_s: float, parameters: CompletionParameters
) -> int | None:
    """Return the tick at which contact was complete, looked for from the tick `first` (the detected impact) on.

    Velocities are differences of the measured O_T_EE: the log alone is enough, and the detector's own Jacobian is
    within the encoders' noise of them. None where there was no full contact within patience_s.
    """
    t_s = (columns.arm[0]["t_ns"] - columns.arm[0]["t_ns"][0]) * 1e-9
    last = int(np.searchsorted(t_s, t_s[min(first, len(t_s) - 1)] + patience_s))
    span = slice(first - SLOPE, last + SLOPE)
    if first < SLOPE or last + SLOPE > len(t_s):
        return None
    duration_s = (t_s[span][2 * SLOPE :] - t_s[span][: -2 * SLOPE])[:, None]
    force, rotation, velocity = [], [], []
    for arm, mounting in enumerate((description.left, description.right)):
        world = base_frame(mounting).rotation
        pose = columns.arm[arm]["O_T_EE"][span]
        place = pose[:, :3, 3] @ world.T
        velocity.append((place[2 * SLOPE :] - place[: -2 * SLOPE]) / duration_s)
        rotation.append(world @ pose[SLOPE:-SLOPE, :3, :3])
        force.append(-columns.arm[arm]["O_F_ext_hat_K"][first:last, :3] @ world.T)  # ON the end effector
    detectors = (CompletionDetector(parameters), CompletionDetector(parameters))
    for k in range(last - first):
        held = [
            detector.update(t_s[first + k], force[a][k], rotation[a][k], velocity[a][k], velocity[1 - a][k])
            for a, detector in enumerate(detectors)
        ]
        if all(held):
            return first + k
    return None
