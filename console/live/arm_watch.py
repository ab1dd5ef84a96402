"""What one arm last said, how old that is, and how well the loop keeps time, from their rings."""

from collections import deque
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.limits import CONTROL_PERIOD_S
from hal.robot_errors import error_names
from hal.state import RobotMode
from rtstack.log.ring import RingReader, Rings
from rtstack.loop.standstill import REST_DQ
from rtstack.model.cell_description import ArmMounting, Frame, base_frame
from rtstack.model.rotation import quaternion_from_rotation
from rtstack.samples import Mode

_WINDOW = 2000  # ticks, 2 s: what period, p99 and missed share are about
_PERIOD_US = 1e6 * CONTROL_PERIOD_S
# libfranka leaves 300 us of a period to the answer (docs, "system requirements"; `rtstack check` has the same bound)
_LATE_US = 300.0
_GOOD = 0.95  # share of answers in time below which libfranka speaks of many lost packets (communication_test.cpp)
_PEAK_SAMPLES = 3  # 60 ms: a page sees a view every 50 ms
_GAP_NS = 200_000_000  # a longer one is no motion that was seen
NEVER_S = 1e6  # an age before the first record
_ROBOT_MODES, _MODES = ({int(member): member.name for member in kind} for kind in (RobotMode, Mode))


class Keeping(StrEnum):
    """How well something keeps time: as it should, so that it is to be looked after, so that the robot may give up."""

    GOOD = "good"
    LATE = "late"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class LoopView:
    """The loop over the last 2 s. Periods us; None before the first tick; missed since the console started.

    lateness: what the 99th percentile of the periods means; losses: what the ticks that were missed in the 2 s mean.
    """

    period_us: float | None = None
    period_p99_us: float | None = None
    missed: int = 0
    lateness: Keeping = Keeping.GOOD
    losses: Keeping = Keeping.GOOD


class LoopWatch:
    """Follows /timing."""

    def __init__(self, reader: RingReader) -> None:
        self._reader = reader
        self._periods = np.empty(0)
        self._missed_each = np.empty(0)  # ticks missed before each of the newest records
        self._missed = self._counted = 0

    def view(self) -> LoopView:
        """Take the ticks since the last call, and return the view over the newest."""
        records = self._reader.drain()
        if len(records):
            periods = records["period_us"]
            self._periods = np.concatenate([self._periods, periods[np.isfinite(periods)]])[-_WINDOW:]
            counts = np.concatenate([[self._counted], records["missed_deadlines"]])
            steps = np.diff(counts)  # each job counts from zero again
            missed = np.where(steps >= 0, steps, counts[1:])
            self._missed += int(missed.sum())
            self._missed_each = np.concatenate([self._missed_each, missed])[-_WINDOW:]
            self._counted = int(counts[-1])
        if not len(self._periods):
            return LoopView(missed=self._missed)
        p99_us = float(np.percentile(self._periods, 99))
        lost = float(self._missed_each.sum())
        in_time = 1.0 - lost / (lost + len(self._missed_each))
        lateness = Keeping.GOOD if p99_us < _PERIOD_US + _LATE_US else Keeping.LATE
        losses = Keeping.GOOD if lost == 0.0 else Keeping.LATE if in_time >= _GOOD else Keeping.BAD
        return LoopView(float(self._periods.mean()), p99_us, self._missed, lateness, losses)


@dataclass(frozen=True, slots=True)
class ArmView:
    """One arm. `age_s` since the last new state, `success_rate` as the robot reports it. Of its pad: the force now and
    the largest of the last 60 ms, so that no view misses an impact's spike; the speed that is asked of it by hand, and
    the one that it has, from the way of the last 20 ms.
    """

    robot_mode: str = "UNKNOWN"
    errors: tuple[str, ...] = ()
    mode: str = "UNKNOWN"
    age_s: float = NEVER_S
    success_rate: float = 0.0
    force_n: float | None = None
    speed_m_s: float | None = None
    peak_force_n: float | None = None
    pad_speed_m_s: float | None = None


class ArmWatch:
    """Follows one arm's rings."""

    def __init__(self, rings: Rings, side: str, mounting: ArmMounting) -> None:
        self._base = base_frame(mounting)
        self.measured: NDArray[np.float64] | None = None
        self.told: NDArray[np.float64] | None = None
        self.force: NDArray[np.float64] | None = None
        self._arm, self._control = (rings.reader(f"/{side}/{what}") for what in ("arm", "control"))
        self.t_ns = 0  # robot's time of the newest state
        self.changed_s = float("-inf")  # monotonic time of the last new state
        self.moved_s = float("-inf")  # monotonic time of the last new state in which a joint moved
        self.q: NDArray[np.float64] | None = None
        self._peaks: deque[float] = deque(maxlen=_PEAK_SAMPLES)
        self.hit: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None  # see Watch.hits
        self._place: tuple[int, NDArray[np.float64]] | None = None  # where the pad was, t_ns and m

    def view(self, now_s: float) -> ArmView:
        """Return what the arm last said; now_s: monotonic time, s, from which its age is counted."""
        record, control = self._arm.latest(), self._control.latest()
        if record is None:
            return ArmView()
        t_ns = int(record["t_ns"][0])
        if t_ns != self.t_ns or self.changed_s < 0.0:
            self.t_ns, self.changed_s = t_ns, now_s
            if np.abs(record["dq"]).max() > REST_DQ:
                self.moved_s = now_s
        self.q = record["q"][0]
        self.measured, self.force = in_world(self._base, record[0], self.measured)
        told = None if control is None or control["mode"][0] != Mode.TELEOPERATION else control[0]
        self.told = None if told is None else told["pose_ref"].copy()
        rate = float(record["control_command_success_rate"][0])
        self._peaks.append(self._largest_force())
        return ArmView(
            robot_mode=_ROBOT_MODES.get(int(record["robot_mode"][0]), "UNKNOWN"),
            errors=error_names(int(record["current_errors"][0])),
            mode="UNKNOWN" if control is None else _MODES.get(int(control["mode"][0]), "UNKNOWN"),
            age_s=now_s - self.changed_s,
            success_rate=rate if np.isfinite(rate) else 0.0,
            force_n=float(np.linalg.norm(self.force)),
            speed_m_s=None if told is None else float(np.linalg.norm(told["twist_ref"][:3])),
            peak_force_n=max(self._peaks),
            pad_speed_m_s=self._pad_speed(t_ns, record["O_T_EE"][0][:3, 3]),
        )

    def _largest_force(self) -> float:
        """Return the largest force on the pad since the last call, N."""
        records = self._arm.drain()
        if not len(records):
            return 0.0 if self.force is None else float(np.linalg.norm(self.force))
        sizes = np.linalg.norm(records["O_F_ext_hat_K"][:, :3], axis=1)
        most = int(sizes.argmax())
        if self.hit is None or sizes[most] > np.linalg.norm(self.hit[1]):
            pose, force = in_world(self._base, records[most])
            self.hit = pose[:3], force
        return float(sizes[most])

    def _pad_speed(self, t_ns: int, place: NDArray[np.float64]) -> float | None:
        """Return the mean speed since the last call, m/s; None across a gap, and where time began anew."""
        before, self._place = self._place, (t_ns, place)
        if before is None or not 0 < t_ns - before[0] < _GAP_NS:
            return 0.0 if before is not None and t_ns == before[0] else None
        return float(np.linalg.norm(place - before[1])) / (1e-9 * (t_ns - before[0]))


def in_world(
    base: Frame, record: Any, before: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a pad's pose (7,), m, wxyz with the sign of `before`, and its force (3,), N, in the world."""
    frame, pose = record["O_T_EE"], np.zeros(7) if before is None else before.copy()
    pose[:3] = base.translation + base.rotation @ frame[:3, 3]
    quaternion_from_rotation(np.ascontiguousarray(base.rotation @ frame[:3, :3]), pose[3:])
    return pose, -(base.rotation @ record["O_F_ext_hat_K"][:3])
