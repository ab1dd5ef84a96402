"""What the arms measure along the axes of their bases, along the world's: a base may stand turned."""

import numpy as np

from hal.arrays import Array
from rtstack.loop.history import Columns

Bases = tuple[Array, Array]  # T_world_base (4, 4) of the left and of the right arm
UPRIGHT: Bases = (np.eye(4), np.eye(4))  # at the world's origin: where only differences of places count


def pad_forces(columns: Columns, bases: Bases) -> Array:
    """Return the force of each pad on its surroundings (2, n, 3), N, along the world's axes, as it is estimated."""
    force = columns.arm["O_F_ext_hat_K"][:, :, :3]
    return np.stack([of @ base[:3, :3].T for of, base in zip(force, bases, strict=True)])


def pad_places(columns: Columns, bases: Bases) -> Array:
    """Return where the middle of each pad's face is in the world (2, n, 3), m."""
    places = columns.arm["O_T_EE"][:, :, :3, 3]
    return np.stack([of @ base[:3, :3].T + base[:3, 3] for of, base in zip(places, bases, strict=True)])
