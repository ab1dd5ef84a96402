"""A point that is fixed to a link of an arm: where it is, how it moves, and its Jacobian, for tasks and limits."""

import math
from typing import NamedTuple

import numpy as np

from hal.base.arrays import Array
from hal.compilation import Step, bound, compiled
from rtstack.control.controller import ObservedArm


@compiled
def observe_point(samples, J0, dJ0, turn, place, offset, joints, position, velocity, jacobian, drift):
    """Write what LinkPoint has, from the Jacobian J0 (6, 7) at the world's origin; its first columns move the point."""
    dq, p = samples[0].dq, position
    for i in range(3):
        p[i] = place[i] + turn[i, 0] * offset[0] + turn[i, 1] * offset[1] + turn[i, 2] * offset[2]
        velocity[i] = drift[i] = 0.0
    wx = wy = wz = ax = ay = az = 0.0
    for k in range(joints):
        x, y, z = J0[3, k], J0[4, k], J0[5, k]
        jacobian[0, k] = J0[0, k] + y * p[2] - z * p[1]
        jacobian[1, k] = J0[1, k] + z * p[0] - x * p[2]
        jacobian[2, k] = J0[2, k] + x * p[1] - y * p[0]
        for i in range(3):
            velocity[i] += jacobian[i, k] * dq[k]
            drift[i] += dJ0[i, k] * dq[k]
        wx, wy, wz = wx + x * dq[k], wy + y * dq[k], wz + z * dq[k]
        ax, ay, az = ax + dJ0[3, k] * dq[k], ay + dJ0[4, k] * dq[k], az + dJ0[5, k] * dq[k]
    # the classical acceleration at zero ddq, as rtstack.control.observation.end_effector has it
    drift[0] += ay * p[2] - az * p[1] + wy * velocity[2] - wz * velocity[1]
    drift[1] += az * p[0] - ax * p[2] + wz * velocity[0] - wx * velocity[2]
    drift[2] += ax * p[1] - ay * p[0] + wx * velocity[1] - wy * velocity[0]


class PointArrays(NamedTuple):
    """What compiled code reads of a LinkPoint."""

    position: Array
    velocity: Array
    jacobian: Array
    drift: Array


@compiled
def distance_row(own: PointArrays, other: PointArrays, jacobian: Array) -> tuple[float, float, float]:
    """Write the gradient n^T J (7,) of the distance d between two points, PointArrays; J: of the first one.

    Return d, m, its rate, m/s, and its drift, m/s^2, which is ddot d where no joint accelerates:
    n^T (a1 - a2) + (v^2 - rate^2) / d.
    """
    square = along = speeds = 0.0
    for i in range(3):
        r, v = own.position[i] - other.position[i], own.velocity[i] - other.velocity[i]
        square, along, speeds = square + r * r, along + r * v, speeds + v * v
    d = math.sqrt(square)
    rate = along / d
    drift = (speeds - rate * rate) / d
    for j in range(7):
        jacobian[j] = 0.0
    for i in range(3):
        n = (own.position[i] - other.position[i]) / d
        drift += n * (own.drift[i] - other.drift[i])
        for j in range(7):
            jacobian[j] += n * own.jacobian[i, j]
    return d, rate, drift


class LinkPoint:
    """A point of a link, in the world; see `update`.

    Attributes:
        arrays: of these four, for compiled code.
        position: (3,), m.
        velocity: (3,), m/s.
        jacobian: (3, 7): velocity = jacobian dq.
        drift: (3,), m/s^2: the point's acceleration at ddq = 0.
        step: what `update` does, for the `steps` of a task or limit that is compiled.
    """

    def __init__(self, arm: ObservedArm, joint: int, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        """Raises ValueError for a joint that is not there.

        Args:
            arm: whose link it is.
            joint: 1 to 7; the link behind it.
            offset: of the point in that joint's frame, m.
        """
        if not 1 <= joint <= 7:
            raise ValueError(f"joint {joint}: expected 1 to 7")
        self.arrays = PointArrays(np.zeros(3), np.zeros(3), np.zeros((3, 7)), np.zeros(3))
        self.position, self.velocity, self.jacobian, self.drift = self.arrays
        model = arm.model
        arguments = (
            arm.sample, model.J0, model.dJ0, *model.joint_placement(joint), np.array(offset, float), joint,
            *self.arrays,
        )  # fmt: skip
        self.step: Step = (observe_point, arguments)
        self.update = bound(observe_point, *arguments)
