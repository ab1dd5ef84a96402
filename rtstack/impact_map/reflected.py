"""The motors' inertia as it is felt at the joints during an impact: Table I of the impact-map paper, kg m^2."""

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from rtstack.control.parameters import InertiaParameters

Array = NDArray[np.floating]


class ReflectedInertia(StrEnum):
    """Which inertia (10) adds to the links' mass matrix.

    B_theta: reduced by the low-level torque loop, the paper's choice; B: of the bare motors; none: links only.
    """

    B_THETA = "B_theta"
    B = "B"
    NONE = "none"


_TABLE = {
    ReflectedInertia.B_THETA: InertiaParameters().B_theta,
    ReflectedInertia.B: np.array([0.6, 0.6, 0.45, 0.45, 0.2, 0.2, 0.2]),
    ReflectedInertia.NONE: np.zeros(7),
}


def joint_inertia(kind: ReflectedInertia) -> Array:
    """Return what is added to the diagonal of an arm's mass matrix, (7,) kg m^2. Do not write to it."""
    return _TABLE[kind]
