"""Via-point paths of a pad and of its arm's posture: (11)-(13) of the impact-map paper."""

from dataclasses import dataclass, field
from math import ceil

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hal.base.arrays import Array
from rtstack.control.records import POINT
from rtstack.planning.request import PlanError
from rtstack.references.quintic import ViaPoint, quintic_motion, quintic_path

Vias = list[ViaPoint]
UNHURRIED_S = 0.8  # for an axis that has no speed to gather


@dataclass(frozen=True, slots=True)
class ArmPath:
    """Via points of one arm: the pad's face along x, y and z, m, and the posture's joint, rad. turn: a time s(t), s:
    the pad turns by s times `turning` (3,) rad/s, along the world's axes; empty where it never does."""

    x: Vias
    y: Vias
    z: Vias
    xi: Vias
    turn: Vias = field(default_factory=list)
    turning: Array = field(default_factory=lambda: np.zeros(3))


def points_along(path: ArmPath, rotation: Array, t_s: Array, period_s: float) -> tuple[NDArray, Array]:
    """Return the points (n,) of POINT at the times t_s (n,), without feedforward, and accelerations (n, 7): of x, y, z
    m/s^2, about them and of the posture's joint rad/s^2. rotation (3, 3): of a pad that has not turned. Accelerations
    are those half a period later: a torque is held for a period, and what it stands for is the middle of it. Half a
    millisecond of a grab's 5 m/s^2 is 0.6 % of its velocity, which feedback would have to take away again."""
    points = np.zeros(len(t_s), POINT)
    acceleration = np.zeros((len(t_s), 7))
    middle_s = t_s + period_s / 2.0
    for axis, vias in enumerate((path.x, path.y, path.z)):
        points["position"][:, axis], points["twist"][:, axis] = quintic_path(vias, t_s)
        acceleration[:, axis] = quintic_motion(vias, middle_s)[2]
    points["xi"], points["dxi"] = quintic_path(path.xi, t_s)
    acceleration[:, 6] = quintic_motion(path.xi, middle_s)[2]
    points["rotation"] = rotation
    if path.turn:
        turned_s, share = quintic_path(path.turn, t_s)
        points["rotation"] = Rotation.from_rotvec(np.outer(turned_s, path.turning)).as_matrix() @ rotation
        points["twist"][:, 3:] = np.outer(share, path.turning)
        acceleration[:, 3:6] = np.outer(quintic_motion(path.turn, middle_s)[2], path.turning)
    return points, acceleration


@dataclass(frozen=True, slots=True)
class Approach:
    """The way of one pad from rest to where it meets the object: positions (3,) m, velocity there (3,) m/s, the
    posture's joint at the start and there, rad. turning (3,): the rotation vector by which the pad turns on the way,
    along the world's axes, rad."""

    start: Array
    contact: Array
    velocity: Array
    xi_start: float
    xi_contact: float
    turning: Array = field(default_factory=lambda: np.zeros(3))

    def least_s(self, steady_s: float) -> float:
        """Return how long it takes, s, with steady_s at constant velocity at its end. A speed v is gathered over d in 2
        d / v, at half of it on average: the path never turns back. Raises PlanError where there is no room."""
        return max(steady_s + self._gathering_s(axis, steady_s) for axis in range(3))

    def path(self, touch_s: float, steady_s: float) -> ArmPath:
        """Return the path that arrives at touch_s and goes straight on at constant velocity; `turn` counts from the
        rotation there."""
        axes, steady = [], touch_s - steady_s
        for axis in range(3):
            v, contact = float(self.velocity[axis]), float(self.contact[axis])
            begin = ViaPoint(steady - self._gathering_s(axis, steady_s), float(self.start[axis]))
            axes.append([begin, ViaPoint(steady, contact - v * steady_s, v), ViaPoint(touch_s + 1.0, contact + v, v)])
        posture = [ViaPoint(0.0, self.xi_start), ViaPoint(steady, self.xi_contact)]
        turn = [ViaPoint(0.0, -1.0), ViaPoint(steady, 0.0)] if self.turning.any() else []
        return ArmPath(*axes, xi=posture, turn=turn, turning=self.turning)

    def _gathering_s(self, axis: int, steady_s: float) -> float:
        v = float(self.velocity[axis])
        if v == 0.0:
            return UNHURRIED_S
        distance = float(self.contact[axis] - self.start[axis]) - v * steady_s
        if not distance * v > 0.0:
            raise PlanError(
                f"no room to gather {abs(v):g} m/s along {'xyz'[axis]}: the pad starts "
                f"{abs(self.contact[axis] - self.start[axis]) * 1e3:.0f} mm from where it meets the object; plan a "
                f"lower speed{' or a greater height' if axis == 2 else ''}"
            )
        return 2.0 * distance / v


def common_touch_s(approaches: list[Approach], rest_s: float, steady_s: float, period_s: float) -> float:
    """Return the time at which all arrive, s: a tick, no earlier than each can after resting for rest_s."""
    least = max(approach.least_s(steady_s) for approach in approaches)
    return ceil((rest_s + least) / period_s - 1e-6) * period_s


def coast(t_s: float, position: float, velocity: float, stop_s: float) -> Vias:
    """Return the via points of a coordinate that comes to rest from this velocity within stop_s."""
    return [ViaPoint(t_s, position, velocity), ViaPoint(t_s + stop_s, position + velocity * stop_s / 2.0)]
