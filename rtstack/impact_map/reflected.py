"""The motors' inertia as it is felt at the joints during an impact, kg m^2: the numbers are the robot model's."""

from enum import StrEnum

import numpy as np

from hal.arrays import Array
from hal.limits import DOF
from hal.robots import FR3, RobotModel


class ReflectedInertia(StrEnum):
    """Which inertia (10) adds to the links' mass matrix.

    B_theta: reduced by the low-level torque loop, the paper's choice; B: of the bare motors; none: links only.
    """

    B_THETA = "B_theta"
    B = "B"
    NONE = "none"


def joint_inertia(kind: ReflectedInertia, robot: RobotModel = FR3) -> Array:
    """Return what is added to the diagonal of an arm's mass matrix, (7,) kg m^2. Do not write to it."""
    return np.zeros(DOF) if kind is ReflectedInertia.NONE else getattr(robot, kind.value)
