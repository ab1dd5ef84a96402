"""What a client asks for with Move: how it wants to move, and how far off it wants to be at most."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.limits import ArmLimits
from hal.robot_errors import error_bit
from sim_robot.fci.protocol import Generator

PATH_DEVIATION = error_bit("max_path_pose_deviation_violation")
GOAL_DEVIATION = error_bit("max_goal_pose_deviation_violation")
# what libfranka sends unless told otherwise (control_loop.h, kDefaultDeviation): translation m, rotation and elbow rad
_ANYWHERE = (10.0, 3.12, 2.0 * math.pi)

Deviation = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Largest deviations from the desired pose, m, rad and rad (elbow), in each ms (path) and at the end (goal)."""

    path: Deviation | None = None
    goal: Deviation | None = None


@dataclass(frozen=True, slots=True)
class MoveRequest:
    """The payload of Move, as numbers; any of them may be nonsense until `valid` says otherwise."""

    controller: int
    generator: int
    path: Deviation
    goal: Deviation
    asynchronous: bool
    velocity: tuple[float, ...]

    @classmethod
    def of(cls, values: tuple) -> "MoveRequest":
        """Return the request of unpacked protocol.PAYLOADS[Command.MOVE]."""
        return cls(values[0], values[1], values[2:5], values[5:8], bool(values[8]), values[9:16])

    def valid(self, limits: ArmLimits) -> bool:
        """False when a deviation, or the velocity of an asynchronous motion, is out of the arm's range. NaN is."""
        if not all(0.0 <= value < math.inf for value in (*self.path, *self.goal)):
            return False
        within = (0.0 <= one <= most + 1e-3 for one, most in zip(self.velocity, limits.dq_max, strict=True))
        return not self.asynchronous or all(within)

    def largest_velocity(self, limits: ArmLimits) -> tuple[float, ...]:
        """Of an asynchronous motion, (7,) rad/s. A client that names none may use all there is."""
        return self.velocity if any(self.velocity) else tuple(limits.dq_max)

    @property
    def tolerances(self) -> Tolerances:
        """What has to be watched: in torque control, and for who accepts any pose, nothing."""
        if self.generator == Generator.NONE:
            return Tolerances()
        path, goal = (
            None if all(one >= any_ for one, any_ in zip(most, _ANYWHERE, strict=True)) else most
            for most in (self.path, self.goal)
        )
        return Tolerances(path, goal)


def deviates(state: np.void, most: Deviation) -> bool:
    """True when a ROBOT_STATE's measured pose or elbow is further than `most` from the desired one."""

    def rotation(name: str) -> NDArray[np.float32]:
        return state[name].reshape(4, 4)[:3, :3]  # column-major: the transpose, for both alike

    away = float(np.linalg.norm(state["O_T_EE"][12:15] - state["O_T_EE_d"][12:15]))
    cosine = (float(np.sum(rotation("O_T_EE") * rotation("O_T_EE_d"))) - 1.0) / 2.0
    turned = math.acos(max(-1.0, min(1.0, cosine)))
    elbow = abs(float(state["elbow"][0] - state["elbow_d"][0]))
    return away > most[0] or turned > most[1] or elbow > most[2]
