"""A log as a cell: arms that show the logged states, whatever torque answers them, and the tracker's logged poses."""

from collections.abc import Sequence
from itertools import count

import numpy as np
from numpy.typing import NDArray

from hal.arm import Arm
from hal.cell import Cell
from hal.errors import ConnectionLost
from hal.state import ARM_STATE, ArmState
from hal.tracker import ObjectPose
from rtstack.control.controller import ObservedArm
from rtstack.control.records import POINT
from rtstack.loop.history import Columns
from rtstack.model.rotation import rotation_from_quaternion
from rtstack.samples import SIDES, Mode


class LoggedArm(Arm):
    """An arm of the log, which nothing moves. tick: of the state that was read last, -1 before the first."""

    def __init__(self, samples: NDArray) -> None:
        self._rows = np.ascontiguousarray(samples[list(ARM_STATE.names or ())]).astype(ARM_STATE)
        self._state = ArmState.empty()
        self.tick = -1

    def read(self) -> ArmState:
        """Return the next state. Raises ConnectionLost at the end of the log."""
        self.tick += 1
        if self.tick >= len(self._rows):
            raise ConnectionLost("the log ends here")
        self._state.record[0] = self._rows[self.tick]
        return self._state


class LoggedTracker:
    """The newest logged pose at the arm's time."""

    def __init__(self, poses: NDArray, arm: LoggedArm, t_ns: NDArray[np.int64]) -> None:
        # what was published in a tick was seen then: the newest one stays
        self._newest = np.searchsorted(poses["t_ns"], t_ns, side="right") - 1
        self._poses, self._arm, self._pose = poses, arm, ObjectPose.empty()

    def latest(self) -> ObjectPose:
        newest = self._newest[min(self._arm.tick, len(self._newest) - 1)] if self._arm.tick >= 0 else -1
        if newest >= 0:
            self._pose.record[0] = self._poses[newest]
        return self._pose


class LoggedStop:
    """The stop that came from outside of the tick, in the tick in which the log has it. Asked once a tick."""

    def __init__(self, columns: Columns) -> None:
        stopping = np.flatnonzero(columns.control[0]["mode"] == Mode.STOPPING)
        self._ticks, self._from = count(), int(stopping[0]) if len(stopping) else len(columns.timing)

    @property
    def stop_requested(self) -> bool:
        return next(self._ticks) >= self._from


class LoggedSource:
    """The setpoints of a run that was led by hand, as the log has them; see rtstack.loop.session.PointSource."""

    def __init__(self, columns: Columns) -> None:
        self.points = np.zeros((len(columns.control), 1), POINT)
        self._control = columns.control
        self._ticks = tuple(count() for _ in columns.control)

    def listen(self) -> None:
        """See rtstack.loop.session.PointSource: nothing comes beside the log."""

    def step(self, side: int, arm: ObservedArm) -> None:
        """Write the logged point of the next tick of an arm."""
        k = next(self._ticks[side])
        point, logged = self.points[side, 0], self._control[side, k]
        point["position"], point["rotation"] = logged["pose_ref"][:3], rotation_from_quaternion(logged["pose_ref"][3:])
        point["twist"], point["wrench_ff"] = logged["twist_ref"], logged["wrench_ff"]
        if k == 0:
            point["xi"] = arm.sample["q"][0, arm.parameters.posture_joint]


def logged_cell(name: str, columns: Columns, sides: Sequence[str] = SIDES) -> Cell:
    """Return the cell of a log's columns, of the arms of these sides."""
    arms = {side: LoggedArm(samples) for side, samples in zip(sides, columns.arm, strict=True)}
    tracker = LoggedTracker(columns.object, arms[sides[0]], columns.arm[0]["t_ns"])
    return Cell(name, arms.get("left"), arms.get("right"), tracker)
