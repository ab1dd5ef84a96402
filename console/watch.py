"""What the robot last said, and how old that is: two threads that watch the rings and the robot process.

A page never guesses: every number here comes from a record, and its age is counted from when a new one was seen.
"""

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from console.presence import Presence
from hal.robot_errors import error_names
from hal.state import RobotMode
from rtstack.live.client import RobotClient, RobotRefused, RobotUnreachable
from rtstack.live.protocol import BeatRequest, Status, StatusRequest
from rtstack.log.ring import RingReader, Rings
from rtstack.model.cell_description import ArmMounting, CellDescription, base_frame
from rtstack.model.rotation import quaternion_from_rotation
from rtstack.samples import SIDES, Level, Mode

_SAMPLE_PERIOD_S = 0.02  # how finely an age is known
_LOOP_EVERY = 10  # samples: statistics need no more than 5 Hz
_STATUS_PERIOD_S = 0.1
STATUS_TIMEOUT_S = 2.0  # of the client that this module is given
_WINDOW = 2000  # ticks, 2 s: what period and p99 are about
_PEAK_SAMPLES = 3  # 60 ms: a page sees a view every 50 ms
_GAP_NS = 200_000_000  # a longer one is no motion that was seen
_EVENTS = 200  # the newest events that a page can open
NEVER_S = 1e6  # an age before the first record


@dataclass(frozen=True, slots=True)
class ArmView:
    """One arm. `age_s` since the last new state, `success_rate` as the robot reports it.

    Of its pad: the force now and the largest of the last 60 ms, so that no view misses an impact's spike; the speed
    that is asked of it by hand, and the one that it has, from the way of the last 20 ms.
    """

    robot_mode: str
    errors: tuple[str, ...]
    mode: str
    age_s: float
    success_rate: float
    force_n: float | None = None
    speed_m_s: float | None = None
    peak_force_n: float | None = None
    pad_speed_m_s: float | None = None


@dataclass(frozen=True, slots=True)
class LoopView:
    """The loop over the last 2 s. Periods us; None before the first tick; missed since the console started."""

    period_us: float | None
    period_p99_us: float | None
    missed: int


@dataclass(frozen=True, slots=True)
class EventView:
    """An event: robot's time s (each job may begin at 0 again), Unix time s when it was seen, severity, who, what."""

    number: int
    t_s: float
    seen_s: float
    level: str
    name: str
    text: str


@dataclass(frozen=True, slots=True)
class LiveView:
    """Everything that the live page shows, 20 times a second."""

    left: ArmView
    right: ArmView
    loop: LoopView
    status: Status | None
    status_age_s: float
    unreachable: str | None
    event: EventView | None


class _ArmWatch:
    """Follows one arm's rings."""

    def __init__(self, rings: Rings, side: str, mounting: ArmMounting) -> None:
        self._base = base_frame(mounting)
        self._base_wxyz = np.array(mounting.base_orientation_wxyz)
        self.measured: NDArray[np.float64] | None = None
        self.told: NDArray[np.float64] | None = None
        self.force: NDArray[np.float64] | None = None
        self._arm = rings.reader(f"/{side}/arm")
        self._control = rings.reader(f"/{side}/control")
        self._t_ns = 0
        self._changed_s: float | None = None
        self.q: NDArray[np.float64] | None = None
        self._peaks: deque[float] = deque(maxlen=_PEAK_SAMPLES)
        self._place: tuple[int, NDArray[np.float64]] | None = None  # where the pad was, t_ns and m

    def view(self, now_s: float) -> ArmView:
        record, control = self._arm.latest(), self._control.latest()
        if record is None:
            return ArmView("UNKNOWN", (), "UNKNOWN", NEVER_S, 0.0)
        t_ns = int(record["t_ns"][0])
        if t_ns != self._t_ns or self._changed_s is None:
            self._t_ns, self._changed_s = t_ns, now_s
        self.q = record["q"][0]
        speed = self._take_pad(record[0], control)
        rate = float(record["control_command_success_rate"][0])
        self._peaks.append(self._largest_force())
        return ArmView(
            robot_mode=_name(RobotMode, record["robot_mode"][0]),
            errors=error_names(int(record["current_errors"][0])),
            mode="UNKNOWN" if control is None else _name(Mode, control["mode"][0]),
            age_s=now_s - self._changed_s,
            success_rate=rate if np.isfinite(rate) else 0.0,
            force_n=float(np.linalg.norm(self.force)) if self.force is not None else None,
            speed_m_s=speed,
            peak_force_n=max(self._peaks),
            pad_speed_m_s=self._pad_speed(t_ns, record["O_T_EE"][0][:3, 3]),
        )

    def _largest_force(self) -> float:
        """Return the largest force on the pad since the last call, N."""
        forces = self._arm.drain()["O_F_ext_hat_K"][:, :3]
        if not len(forces):
            return 0.0 if self.force is None else float(np.linalg.norm(self.force))
        return float(np.linalg.norm(forces, axis=1).max())

    def _pad_speed(self, t_ns: int, place: NDArray[np.float64]) -> float | None:
        """Return the mean speed since the last call, m/s; None across a gap, and where time began anew."""
        before, self._place = self._place, (t_ns, place)
        if before is None or not 0 < t_ns - before[0] < _GAP_NS:
            return 0.0 if before is not None and t_ns == before[0] else None
        return float(np.linalg.norm(place - before[1])) / (1e-9 * (t_ns - before[0]))

    def _take_pad(self, record: Any, control: NDArray | None) -> float | None:
        """Take where the pad is, in the world, what it was told, and what it feels; return its speed, m/s."""
        base, pose = self._base, record["O_T_EE"]
        measured = np.zeros(7)
        measured[:3] = base.translation + base.rotation @ pose[:3, 3]
        quaternion_from_rotation(np.ascontiguousarray(base.rotation @ pose[:3, :3]), measured[3:])
        self.measured = measured
        self.force = -(base.rotation @ record["O_F_ext_hat_K"][:3])
        led = control is not None and int(control["mode"][0]) == Mode.TELEOPERATION
        self.told = control["pose_ref"][0].copy() if led and control is not None else None
        return float(np.linalg.norm(control["twist_ref"][0][:3])) if led and control is not None else None


class _LoopWatch:
    """Follows /timing."""

    def __init__(self, reader: RingReader) -> None:
        self._reader = reader
        self._periods = np.empty(0)
        self._missed = 0
        self._counted = 0

    def view(self) -> LoopView:
        records = self._reader.drain()
        if len(records):
            periods = records["period_us"]
            self._periods = np.concatenate([self._periods, periods[np.isfinite(periods)]])[-_WINDOW:]
            counts = np.concatenate([[self._counted], records["missed_deadlines"]])
            steps = np.diff(counts)  # each job counts from zero again
            self._missed += int(np.where(steps >= 0, steps, counts[1:]).sum())
            self._counted = int(counts[-1])
        if not len(self._periods):
            return LoopView(None, None, self._missed)
        return LoopView(float(self._periods.mean()), float(np.percentile(self._periods, 99)), self._missed)


class Watch:
    """The threads. `view`, `q` and `object_pose` may be read from any thread; they are replaced, never changed.

    document: the view as JSON, made once for all who look.

    Who asks the robot process for its status also passes on the holder's signs of life.
    """

    def __init__(self, rings: Rings, client: RobotClient, presence: Presence, cell: CellDescription) -> None:
        self.rings = rings
        mountings = {"left": cell.left, "right": cell.right}
        self._arms = {side: _ArmWatch(rings, side, mountings[side]) for side in SIDES}
        self._loop = _LoopWatch(rings.reader("/timing"))
        self._object = rings.reader("/object/pose")
        self._event_reader = rings.reader("/events")
        self._client = client
        self._presence = presence
        self._ending = threading.Event()
        self._events: deque[EventView] = deque(maxlen=_EVENTS)
        self._event_count = 0
        self._status: tuple[Status | None, float | None, str | None] = (None, None, "not asked yet")
        unknown = ArmView("UNKNOWN", (), "UNKNOWN", NEVER_S, 0.0)
        self.view = LiveView(unknown, unknown, LoopView(None, None, 0), None, NEVER_S, None, None)
        self.document = msgspec.json.encode(self.view)
        self._threads = [
            threading.Thread(target=self._watch_rings, daemon=True, name="watch rings"),
            threading.Thread(target=self._watch_status, daemon=True, name="watch status"),
        ]

    def start(self) -> None:
        """Begin to watch."""
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """End both threads."""
        self._ending.set()
        for thread in self._threads:
            if thread.is_alive():
                thread.join()

    def events(self) -> tuple[EventView, ...]:
        """Return the newest events, oldest first."""
        return tuple(self._events)

    def q(self) -> NDArray[np.float64] | None:
        """Return both arms' joints, (2, 7) rad, None until both have spoken."""
        joints = [self._arms[side].q for side in SIDES]
        return None if any(q is None for q in joints) else np.array(joints)

    def measured(self) -> NDArray[np.float64] | None:
        """Return both pads' poses in the world, (2, 7) position m and quaternion wxyz, None until both have spoken."""
        return _both([self._arms[side].measured for side in SIDES])

    def command(self) -> NDArray[np.float64] | None:
        """Return the poses that a teleoperation asks of both arms, as `measured`; None while there is none."""
        return _both([self._arms[side].told for side in SIDES])

    def forces(self) -> NDArray[np.float64] | None:
        """Return the forces on both pads, (2, 3) N in the world, None until both have spoken."""
        return _both([self._arms[side].force for side in SIDES])

    def object_pose(self) -> NDArray[np.float64] | None:
        """Return the object's pose, (7,) position m and quaternion wxyz, None until it was seen."""
        record = self._object.latest()
        if record is None or not record["seen"][0]:
            return None
        return np.concatenate([record["position"][0], record["orientation_wxyz"][0]])

    def learn(self, status: Status) -> None:
        """Take a status that an answer brought along, so that a page sees its own order at once."""
        self._status = (status, time.monotonic(), None)

    def _watch_rings(self) -> None:
        samples = 0
        loop = self.view.loop
        while not self._ending.wait(_SAMPLE_PERIOD_S):
            if samples % _LOOP_EVERY == 0:
                loop = self._loop.view()
            samples += 1
            now_s = time.monotonic()
            for record in self._event_reader.drain():
                self._event_count += 1
                self._events.append(_event(self._event_count, record))
            status, asked_s, unreachable = self._status
            self.view = LiveView(
                left=self._arms["left"].view(now_s),
                right=self._arms["right"].view(now_s),
                loop=loop,
                status=status,
                status_age_s=NEVER_S if asked_s is None else now_s - asked_s,
                unreachable=unreachable,
                event=self._events[-1] if self._events else None,
            )
            self.document = msgspec.json.encode(self.view)

    def _watch_status(self) -> None:
        while not self._ending.wait(_STATUS_PERIOD_S):
            status = self._status[0]
            holder = status.holder if status is not None else None
            heard = self._presence.heard(holder)
            try:
                answer = self._client.request(BeatRequest(holder) if holder and heard else StatusRequest())
                self._status = (answer, time.monotonic(), None)
            except (RobotUnreachable, RobotRefused) as error:
                status, asked_s, _ = self._status
                self._status = (status, asked_s, str(error))


def _both(values: list[NDArray[np.float64] | None]) -> NDArray[np.float64] | None:
    return None if any(value is None for value in values) else np.array(values)


def _name(kind: type[RobotMode] | type[Mode], value: object) -> str:
    try:
        return kind(int(value)).name  # type: ignore[call-overload]
    except ValueError:
        return "UNKNOWN"


def _event(number: int, record: Any) -> EventView:
    level = int(record["level"])
    return EventView(
        number=number,
        t_s=float(record["t_ns"]) * 1e-9,
        seen_s=time.time(),
        level=Level(level).name if level in Level._value2member_map_ else "INFO",
        name=record["name"].decode("ascii", "replace"),
        text=record["text"].decode("ascii", "replace"),
    )
