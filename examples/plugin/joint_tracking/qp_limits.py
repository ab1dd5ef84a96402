"""Limits of the QP in plain numpy: distance to the table, a velocity damper, a force of the pad."""

import numpy as np

from hal.base.arrays import Array
from rtstack.control.controller import ObservedArm
from rtstack.control.limits import JointLimit, Limit
from rtstack.control.link_point import LinkPoint

TIME_S = 0.05  # see arms_apart.py


class AboveTable(Limit):
    """Elbow and wrist stay this high above the table's top, in the world, m."""

    def __init__(self, arm: ObservedArm, top_z: float, least_m: float = 0.1) -> None:
        super().__init__(2)
        self._points, self._lowest = [LinkPoint(arm, joint) for joint in (4, 6)], top_z + least_m

    def update(self) -> None:
        """Bound ddot z >= -2 / T dot z - (z - lowest) / T^2."""
        for row, point in enumerate(self._points):
            point.update()
            self.jacobian[row] = point.jacobian[2]
            height = point.position[2] - self._lowest
            self.lower[row] = -2.0 / TIME_S * point.velocity[2] - height / TIME_S**2 - point.drift[2]


class VelocityDamper(JointLimit):
    """Each joint slows down before a line of its position, lower and upper (7,), rad: dq <= gain (line - q)."""

    def __init__(self, arm: ObservedArm, lower: np.ndarray, upper: np.ndarray, gain: float = 4.0) -> None:
        super().__init__()
        self._q, self._dq = arm.sample[0]["q"], arm.sample[0]["dq"]
        self._line, self._gain = (lower, upper), gain

    def update(self) -> None:
        """Bound ddq so that the rate is kept within a time constant."""
        for bound, line in zip((self.lower, self.upper), self._line, strict=True):
            bound[:] = (self._gain * (line - self._q) - self._dq) / TIME_S


class PadForce(Limit):
    """The force that the pad exerts along an axis of the world (3,) where something holds it, at most so many N."""

    def __init__(self, arm: ObservedArm, axis: np.ndarray, most_n: float) -> None:
        super().__init__(1)
        self._work, self._axis, self._most_n = arm.workspace[0], np.append(axis, np.zeros(3)), most_n

    def update(self) -> None:
        """Bound axis^T Lambda (J ddq + dJ dq): the wrench whose acceleration the QP asks of the pad."""
        J: Array = self._work["J"]
        M: Array = self._work["M"]
        inverse: Array = J @ np.linalg.solve(M, J.T)
        row: Array = self._axis @ np.linalg.inv(inverse)
        self.jacobian[0] = row @ J
        drift = float(np.dot(row, self._work["dJdq"]))
        self.lower[0], self.upper[0] = -self._most_n - drift, self._most_n - drift
