"""What one arm last said, and how old that is, from its rings."""

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.robot_errors import error_names
from hal.state import RobotMode
from rtstack.log.ring import Rings
from rtstack.loop.standstill import REST_DQ
from rtstack.model.cell_description import ArmMounting, Frame, base_frame
from rtstack.model.rotation import quaternion_from_rotation
from rtstack.samples import Mode

_PEAK_SAMPLES = 3  # 60 ms: a page sees a view every 50 ms
_GAP_NS = 200_000_000  # a longer one is no motion that was seen
NEVER_S = 1e6  # an age before the first record
_ROBOT_MODES, _MODES = ({int(member): member.name for member in kind} for kind in (RobotMode, Mode))


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
