"""Leads the pads through a few straight ways: away from each other, down until the table carries what they hold, home.

The commands come out of the teleoperation's filter (rtstack.teleoperation.follower): bounded in speed, acceleration and
jerk. A pad that presses begins as far ahead of itself as its spring is pressed, so that its force goes on.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.limits import CONTROL_PERIOD_S
from rtstack.control.controller import ObservedArm
from rtstack.control.records import POINT
from rtstack.loop.end import End
from rtstack.loop.watchdogs import WatchdogTrip
from rtstack.samples import Level, Mode
from rtstack.teleoperation.follower import FOLLOWER, advance, begin, compile_follower, coordinates, hold, write_point
from rtstack.teleoperation.reach import TURN_RAD_M, Reach

SPEED_M_S = 0.12
LOWER_M_S = 0.06
CARRIED_M = 0.005  # both commands so far below their pads, on average: springs press on the table, not against weight
CARRIED_TICKS = 30
_AT_GOAL_M, _AT_GOAL_RAD, _RESTING = 5e-4, 2e-3, 2e-3  # the last: m/s and rad/s
_XI_RAD_S = 0.3  # of the posture, on the way home


@dataclass(frozen=True, slots=True)
class Home:
    """Where the arms begin: position (arms, 3) m and rotation (arms, 3, 3) of the pads' faces, xi (arms,) rad."""

    position: NDArray[np.floating]
    rotation: NDArray[np.floating]
    xi: NDArray[np.floating]


class Mover:
    """A point source of a session, and one of its watchdogs: it ends the session once the last way is gone.

    opening: how far each pad goes away from the other, an only one backwards, m; lower: first, until the table carries;
    home: where they go in the end, None where they stay. stiffness: of the springs between command and pad, N/m.
    """

    def __init__(
        self, reach: Reach, stiffness: float, opening_m: float, lower: bool, home: Home | None, arms: int = 2
    ) -> None:
        self.points = np.zeros((arms, 1), POINT)
        self.problem = ""  # why it ended early
        self._over = False
        self.lowered_m = 0.0
        self._reach, self._stiffness, self._opening_m, self._home = reach, stiffness, opening_m, home
        self._followers = np.zeros((arms, 1), FOLLOWER)
        self._position = [np.zeros(3)] * arms  # of the pads, views of the observed arms
        self._rotation = [np.eye(3)] * arms
        self._mode = np.zeros(1, np.int64)
        self._begun = [False] * arms
        self._began_z = 0.0
        self._pressed = 0
        self._goal = np.zeros(6)
        self._ways: list[Callable[[], None]] = [
            *([self._lower] if lower else []), *([self._open] if opening_m else []), *([self._go_home] if home else []),
        ]  # fmt: skip
        self._count = len(self._ways)
        self._lowering = self._homing = False
        self._speed = SPEED_M_S
        compile_follower(arms)

    @property
    def share(self) -> float:
        """How much of the ways is over, 0 to 1, roughly."""
        return 1.0 - len(self._ways) / max(1, self._count) - 0.5 / max(1, self._count)

    def listen(self) -> None:
        """See rtstack.loop.session.PointSource: choose the next way once the last one is gone."""
        if not all(self._begun) or self._mode[0] == Mode.STOPPING:
            return
        if self._lowering and self._carried():
            self._lowering = False
            self.lowered_m = self._began_z - self._mean_z()
            hold(self._followers)
        if not self._arrived():
            return
        if self._lowering:
            self.problem = "the pads are as low as they may go, and the table does not carry it: it is still held"
        if self._lowering or not self._ways:
            self._over = True
            return
        self._speed = SPEED_M_S
        self._ways.pop(0)()

    def trip(self) -> WatchdogTrip | None:
        """See rtstack.loop.watchdogs.Watchdog: the last way is gone."""
        return WatchdogTrip(End.COMPLETED, "", Level.INFO) if self._over else None

    def step(self, side: int, arm: ObservedArm) -> None:
        """Write the point of this tick of an arm whose state was observed."""
        follower, point = self._followers[side], self.points[side]
        work = arm.workspace[0]
        if not self._begun[side]:
            self._begun[side] = True
            self._position[side], self._rotation[side] = work["position"], work["rotation"]
            self._mode = arm.control["mode"]
            begin(follower, work["position"] - work["force_world"] / self._stiffness, work["rotation"])
            point["xi"] = arm.sample["q"][0, arm.parameters.posture_joint]
        advance(follower, self._speed, TURN_RAD_M * self._speed)
        write_point(follower, point)
        if self._homing and self._home is not None:
            step = _XI_RAD_S * CONTROL_PERIOD_S
            point["xi"] += min(max(self._home.xi[side] - point["xi"][0], -step), step)

    def _lower(self) -> None:
        self._lowering, self._speed, self._began_z = True, LOWER_M_S, self._mean_z()
        # as far as the lower one may: they stay as high above each other as they are
        low = min(float(position[2]) for position in self._position)
        for goal in self._followers["goal"][:, 0]:
            goal[2] += min(0.0, self._reach.lower[2] - low - 2.0 * CARRIED_M)

    def _open(self) -> None:
        goals = self._followers["goal"][:, 0]
        for goal, position, outwards in zip(goals, self._position, self._outwards(), strict=True):
            away = position + self._opening_m * outwards
            for i in (0, 1) if len(self._position) == 1 else (1,):
                goal[i] = min(max(away[i], self._reach.lower[i]), self._reach.upper[i])
            goal[2] = max(float(position[2]), self._reach.lower[2])

    def _outwards(self) -> NDArray[np.float64]:
        """Return the directions (arms, 3) away from what is between the pads, or in front of an only one."""
        if len(self._position) == 1:
            return -self._rotation[0][None, :, 2]
        return np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])

    def _go_home(self) -> None:
        home = self._home
        assert home is not None
        self._homing = True
        for side in range(len(self._followers)):
            coordinates(self._followers[side], home.position[side], home.rotation[side], self._goal)
            self._followers["goal"][side, 0] = self._goal

    def _mean_z(self) -> float:
        return float(np.mean([position[2] for position in self._position]))

    def _carried(self) -> bool:
        below = self._mean_z() - float(self._followers["command"][:, 0, 2].mean())
        self._pressed = self._pressed + 1 if below > CARRIED_M else 0
        return self._pressed >= CARRIED_TICKS

    def _arrived(self) -> bool:
        for follower in self._followers[:, 0]:
            far = follower["goal"] - follower["command"]
            if np.abs(far[:3]).max() > _AT_GOAL_M or np.abs(far[3:]).max() > _AT_GOAL_RAD:
                return False
            if np.abs(follower["velocity"]).max() > _RESTING:
                return False
        if not self._homing or self._home is None or self._ways:
            return True
        return bool(np.abs(self._home.xi - self.points["xi"][:, 0]).max() < _AT_GOAL_RAD)
