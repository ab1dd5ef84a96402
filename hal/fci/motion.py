"""Both arms to a posture, by the robots' own joint position controllers: no torque of ours is involved.

Each arm is answered when its own state arrives, by its own clock. A stop request is obeyed during the motion: its
time runs slower and slower, so that both arms stay on it.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from hal.arrays import Array
from hal.cell import LEFT, RIGHT
from hal.errors import CommandRejected
from hal.joint_path import JointPath, JointSpeed
from hal.limits import CONTROL_PERIOD_S

if TYPE_CHECKING:
    from hal.fci.pair import FciPair

BRAKE_S = 0.3  # from full speed to rest after a stop request: 2.5 rad/s^2 at 0.5 rad/s
SETTLE_S = 0.2  # the last posture is held this long before the motion is ended
LONG_GAP_S = 5e-3  # worth a word where the robot has ended the motion
LONGEST_STEP_S = 0.02  # of one answer: after 20 ms without one the robot has ended the motion by itself


class _Progress:
    """How far one arm is on the way. t_s: its time on it; still_s: how long it has been at its end."""

    def __init__(self) -> None:
        self.t_s = self.still_s = self.braking_s = 0.0
        self.stamp_ns = -1
        self.longest_gap_s = 0.0  # between two answers, by the robot's clock
        self._answers = 0

    def step(self, t_ns: int, end_s: float, stopping: bool) -> None:
        """Go on to a new state's time."""
        gap_s = 1e-9 * (t_ns - self.stamp_ns) if self._answers else 0.0
        step_s = min(gap_s, LONGEST_STEP_S)
        self.longest_gap_s = max(self.longest_gap_s, gap_s if self._answers > 1 else 0.0)
        if self._answers == 1:  # a robot that waits for us has shown its first state several times
            step_s = CONTROL_PERIOD_S
        self.stamp_ns, self._answers = t_ns, self._answers + 1
        self.braking_s += step_s if stopping else 0.0
        x = min(self.braking_s / BRAKE_S, 1.0)
        self.t_s += step_s * (1.0 - (3.0 - 2.0 * x) * x * x)
        self.still_s += step_s if x >= 1.0 or self.t_s >= end_s else 0.0


def move(pair: "FciPair", goal: Array, limit: JointSpeed, stop: Callable[[], bool]) -> bool:
    """Move both arms to goal (2, 7) rad and end the motion; return whether they got there, False after a stop.

    Both begin where the robot wants them to be (q_d), which differs from where they are by the sag of its controller.
    Raises CommandRejected and ConnectionLost; then neither arm moves any more.
    """
    arms = {LEFT: pair.left, RIGHT: pair.right}
    progress = {LEFT: _Progress(), RIGHT: _Progress()}
    rows = {LEFT: 0, RIGHT: 1}
    begins: dict[int, Array] = {}
    path: JointPath | None = None
    stopping = False
    try:
        for arm in arms.values():
            with pair.holding(arm):
                arm.start_positions()
        moving = {LEFT, RIGHT}
        while moving:
            stopping = stopping or stop()
            mask = pair.wait()
            # an arm may be ended as soon as both stand still, but only as the answer to a state of its own
            ending = path is not None and all(one.still_s >= SETTLE_S for one in progress.values())
            for side in [side for side in moving if mask & side]:
                t_ns, q_d = arms[side].read_position()
                begins.setdefault(side, q_d)
                if path is None and len(begins) == 2:
                    path = JointPath.between(np.array([begins[LEFT], begins[RIGHT]]), goal, limit)
                if path is None:
                    arms[side].write_position(begins[side])
                    continue
                progress[side].step(t_ns, path.duration_s, stopping)
                posture = path.at(progress[side].t_s)[rows[side]]
                if not ending:
                    arms[side].write_position(posture)
                    continue
                with pair.holding(arms[side]):
                    arms[side].write_position(posture, finished=True)
                moving.discard(side)
    except CommandRejected as error:
        gap_s = max(one.longest_gap_s for one in progress.values())
        if gap_s < LONG_GAP_S:
            raise
        # the robot goes on along a parabola meanwhile, and finds our way elsewhere when it is back
        why = f"{error} (up to {1e3 * gap_s:.0f} ms had passed between two of our answers: keep the host for the loop)"
        raise CommandRejected(why, error.errors) from None
    finally:
        pair.stop()
    assert path is not None
    return all(one.t_s >= path.duration_s for one in progress.values())
