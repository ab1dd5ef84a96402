"""Contact-completion detector, the reference-spreading paper's future work (part VI): both pads press on the object,
and have stopped moving towards each other."""

import numpy as np

from hal.base.arrays import Array
from hal.compilation import compiled
from rtstack.control.parameters import CompletionParameters


@compiled
def contact_now(t_s, force, rotation, velocity, other_velocity, since, force_n, speed_m_s, hold_s):
    """Return whether this pad has been in lasting contact for `hold_s`; since (1,): from when on, negative if not yet.

    force (3,) N acts ON the end effector; rotation (3, 3) of T_world_ee, its third column the pad's outward normal;
    velocity (3,) m/s of this pad and of the other one. The speed that counts is the pad's along its normal against the
    middle between both pads: an object that was displaced goes on moving with both of them, and is held.
    """
    press = 0.0
    closing = 0.0
    for i in range(3):
        press -= rotation[i, 2] * force[i]
        closing += 0.5 * rotation[i, 2] * (velocity[i] - other_velocity[i])
    if not (press > force_n and abs(closing) < speed_m_s):
        since[0] = -1.0
        return False
    if since[0] < 0.0:
        since[0] = t_s
    return t_s - since[0] >= hold_s - 1e-9


class CompletionDetector:
    """The detector of one arm. The same one runs online and on a recording; contact is complete where both say so."""

    def __init__(self, parameters: CompletionParameters) -> None:
        self._since = np.full(1, -1.0)
        self._force_n, self._speed_m_s, self._hold_s = parameters.force_n, parameters.speed_m_s, parameters.hold_s

    def update(self, t_s: float, force: Array, rotation: Array, velocity: Array, other_velocity: Array) -> bool:
        """Take this arm's state at t_s (see `contact_now`), t_s >= 0 and never less than before."""
        return contact_now(
            t_s, force, rotation, velocity, other_velocity, self._since, self._force_n, self._speed_m_s, self._hold_s
        )
