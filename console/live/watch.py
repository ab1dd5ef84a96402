"""What the robot last said, and how old that is: two threads that watch the rings and the robot process."""

import threading
import time
from collections import deque
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from console.live.arm_watch import NEVER_S, ArmView, ArmWatch
from console.live.heartbeats import OperatorHeartbeats
from console.live.loop_watch import LoopView, LoopWatch
from console.live.remedies import Remedy, remedy_of
from hal.desk import Desk, DeskState, Trust
from hal.errors import HardwareError
from rtstack.live.client import RobotClient, RobotRefused, RobotUnreachable
from rtstack.live.protocol import JobState, Phase, Status
from rtstack.log.ring import Rings
from rtstack.model.cell_description import CellDescription
from rtstack.samples import SIDES, Level

MOVED_S = 0.3  # as long an arm counts as moving after its last motion: at a turning point it stands for a moment
HELD_N = 5.0  # the reference-spreading paper, Appendix B: force_high, above which the detector calls it a contact
_SQUEEZE_SAMPLES = 25  # 0.5 s of the watch: a hit is no holding


class CellWord(StrEnum):
    """What the cell does."""

    UNKNOWN = "waiting"
    DISARMED = "disarmed"
    ARMED = "armed"
    PREPARING = "preparing"
    MOVING = "moving"
    HOLDING = "holding"
    RECOVERING = "recovering"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class CellState:
    """One word for the whole cell, in each page's top bar. The phase of the arming says what is allowed; this what is
    so: a job that is prepared moves nothing, and arms that are disarmed may hold an object.

    `held_n`: with how much both pads squeeze, N, None where they do not; `active`: whether a motion runs
    or begins, so that the arms may move at any moment; `remedy`: what the runbook says of the fault that there is.
    """

    word: CellWord
    held_n: float | None = None
    active: bool = True
    remedy: Remedy | None = None


UNKNOWN = CellState(CellWord.UNKNOWN)


def cell_state(status: Status | None, led: bool, moved: bool, held_n: float | None) -> CellState:
    """Return the state. led: whether all arms have shown a state since the job runs, before which it cannot move them;
    moved: whether an arm has moved within MOVED_S; held_n: of `Squeeze`.
    """
    if status is None:
        return UNKNOWN
    job = status.job
    runs = job is not None and job.active
    active = runs or moved or status.phase in (Phase.MOVING, Phase.RECOVERING)
    if status.phase is Phase.FAULT:
        word = CellWord.FAULT
    elif status.phase is Phase.RECOVERING:
        word = CellWord.RECOVERING
    elif moved:
        word = CellWord.MOVING
    elif runs and job is not None and job.state is not JobState.STARTING and led:
        word = CellWord.HOLDING
    elif status.phase is Phase.MOVING:
        word = CellWord.PREPARING
    elif status.phase is Phase.ARMED:
        word = CellWord.ARMED
    else:
        word = CellWord.DISARMED if held_n is None else CellWord.HOLDING
    return CellState(word, held_n, active, remedy_of(status.reason))


class Squeeze:
    """With how much both pads squeeze what is between them, over the last half second. One alone squeezes nothing."""

    def __init__(self) -> None:
        self._samples: deque[float] = deque(maxlen=_SQUEEZE_SAMPLES)

    def add(self, places: NDArray[np.float64] | None, forces: NDArray[np.float64] | None) -> None:
        """Take the pads' places in the world, (arms, 3) m, and the forces on them, (arms, 3) N; None where unknown."""
        if places is None or forces is None or len(places) == 1:
            self._samples.clear()
            return
        inwards = places[1] - places[0]  # of the left arm; the object pushes the pads apart
        inwards /= max(float(np.linalg.norm(inwards)), 1e-9)
        self._samples.append(min(-float(forces[0] @ inwards), float(forces[1] @ inwards)))

    @property
    def held_n(self) -> float | None:
        """The mean of the smaller one of both pads' forces, N; None below HELD_N."""
        if len(self._samples) < _SQUEEZE_SAMPLES:
            return None
        mean = float(np.mean(self._samples))
        return mean if mean > HELD_N else None


_PERIOD_S = 2.0


@dataclass(frozen=True, slots=True)
class DeskView:
    """One box: `ready` for FCI or not, what it says in a line, and what a person has to do there, a line each."""

    side: str
    ready: bool
    line: str
    todo: tuple[str, ...] = ()


class DeskWatch:
    """A thread for each box that has a Desk in the cell's file. `views` is replaced, never changed."""

    def __init__(self, addresses: Mapping[str, str], trust: Trust | None = None) -> None:
        """addresses: of each arm's Desk by its side, "" for one that is not looked at."""
        self._trust = trust or Trust()
        looked_at = {side: address for side, address in addresses.items() if address}
        self._views = {side: DeskView(side, False, "not asked yet") for side in looked_at}
        self._ending = threading.Event()
        for each in looked_at.items():
            threading.Thread(target=self._watch, args=each, daemon=True, name=f"watch Desk, {each[0]}").start()

    @property
    def views(self) -> tuple[DeskView, ...]:
        """The boxes that are looked at, left before right."""
        return tuple(self._views.values())

    def close(self) -> None:
        """End the threads. One that waits for an answer ends after it, by itself."""
        self._ending.set()

    def _watch(self, side: str, address: str) -> None:
        while not self._ending.is_set():
            try:
                with closing(Desk(address, self._trust, name=f"{side} box")) as desk:
                    while not self._ending.is_set():
                        self._views[side] = _view(side, desk.state())
                        self._ending.wait(_PERIOD_S)
            except HardwareError as error:
                self._views[side] = DeskView(side, False, str(error))
            self._ending.wait(_PERIOD_S)


def _view(side: str, state: DeskState) -> DeskView:
    due = "" if state.self_test_s is None else f", self-test in {state.self_test_s / 3600.0:.1f} h"
    line = f"brakes {state.brakes}, FCI {state.fci.lower()}, {state.operating_mode}{due}, system {state.version}"
    held = (f"control is with {state.control}",) if state.control and not state.ready else ()
    return DeskView(side, state.ready, line, (*state.obstacles, *filter(None, [state.warning]), *held))


_SAMPLE_PERIOD_S = 0.02  # how finely an age is known
_LOOP_EVERY = 10  # samples: statistics need no more than 5 Hz
_STATUS_PERIOD_S = 0.1
STATUS_TIMEOUT_S = 2.0  # of the client that this module is given
_EVENTS = 200  # the newest events that a page can open
_PICTURES = 256  # 5 s of them: an older one is answered by no command that is applied


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
class Places:
    """Where things are in the world, (7,) each of position m and quaternion wxyz: the pad of each arm, where they are
    told to be by hand (None while they are not), and the object (None until it was seen).
    """

    pads: list[list[float]]
    told: list[list[float]] | None
    object: list[float] | None


@dataclass(frozen=True, slots=True)
class LiveView:
    """Everything that the live page shows, 20 times a second. number: of this picture, as commands answer it.

    left, right: None for an arm that the cell does not have.
    """

    left: ArmView | None
    right: ArmView | None
    state: CellState = UNKNOWN
    loop: LoopView = field(default_factory=LoopView)
    status: Status | None = None
    status_age_s: float = NEVER_S
    unreachable: str | None = None
    event: EventView | None = None
    desk: tuple[DeskView, ...] = ()
    places: Places | None = None
    number: int = 0

    @property
    def arms(self) -> tuple[ArmView, ...]:
        """The arms that the cell has, left before right."""
        return tuple(arm for arm in (self.left, self.right) if arm is not None)


class Watch:
    """The threads. `view`, `q` and `object_pose` may be read from any thread; they are replaced, never changed.

    document: the view as JSON, made once for all who look. The thread that asks the robot process for its status also
    passes on the holder's signs of life.
    """

    def __init__(
        self, rings: Rings, client: RobotClient, heartbeats: OperatorHeartbeats, cell: CellDescription
    ) -> None:  # fmt: skip
        self.rings, self._client, self._heartbeats = rings, client, heartbeats
        self._arms = {side: ArmWatch(rings, side, mounting) for side, mounting in cell.mountings.items()}
        self.sides = cell.sides
        self._loop = LoopWatch(rings.reader("/timing"))
        self._desk = DeskWatch({side: mounting.desk for side, mounting in cell.mountings.items()})
        self._squeeze = Squeeze()
        self._runs_since: tuple[int, float] | None = None  # the job that runs, and since when, monotonic s
        self._object = rings.reader("/object/pose")
        self._event_reader = rings.reader("/events")
        self._ending = threading.Event()
        self._events: deque[EventView] = deque(maxlen=_EVENTS)
        self._event_count = 0
        self._job = 0  # the newest one
        self._number = 0
        self._pictures = [(0, 0)] * _PICTURES  # number, and when it was made, monotonic ns
        self._status: tuple[Status | None, float | None, str | None] = (None, None, "not asked yet")
        self._ended = ""
        left, right = (ArmView() if side in self._arms else None for side in SIDES)
        self.view = LiveView(left, right)
        self.document = msgspec.json.encode(self.view)
        watched = {"watch rings": self._watch_rings, "watch status": self._watch_status}
        self._threads = [threading.Thread(target=watch, daemon=True, name=name) for name, watch in watched.items()]
        for thread in self._threads:
            thread.start()

    def end(self, why: str) -> None:
        """Show this line from now on: the robot process has ended."""
        self._ended = why
        self._status = (*self._status[:2], why)

    def close(self) -> None:
        """End both threads."""
        self._desk.close()
        self._ending.set()
        for thread in self._threads:
            thread.join()

    def events(self) -> tuple[EventView, ...]:
        """Return the newest events, oldest first."""
        return tuple(self._events)

    def q(self) -> NDArray[np.float64] | None:
        """Return the arms' joints, (arms, 7) rad, None until all have spoken."""
        return _all([arm.q for arm in self._arms.values()])

    def measured(self) -> NDArray[np.float64] | None:
        """Return the pads' poses in the world, (arms, 7) position m and quaternion wxyz, None until all have spoken."""
        return _all([arm.measured for arm in self._arms.values()])

    def command(self) -> NDArray[np.float64] | None:
        """Return the poses that a teleoperation asks of the arms, as `measured`; None while there is none."""
        return _all([arm.told for arm in self._arms.values()])

    def forces(self) -> NDArray[np.float64] | None:
        """Return the forces on the pads, (arms, 3) N in the world, None until all have spoken."""
        return _all([arm.force for arm in self._arms.values()])

    def picture_ns(self, number: int) -> int | None:
        """Return when a picture was made, monotonic ns; None where there was none of this number, or long ago."""
        known, made_ns = self._pictures[number % _PICTURES]
        return made_ns if known == number > 0 else None

    def robot_time_s(self) -> float:
        """Return the robot's time of the first arm's newest state, s; each job may begin at 0 again."""
        return next(iter(self._arms.values())).t_ns * 1e-9

    def hits(self) -> list[tuple[NDArray[np.float64], NDArray[np.float64]] | None]:
        """Return where each pad has felt most since the newest job began, (3,) m in the world, and what, (3,) N."""
        return [arm.hit for arm in self._arms.values()]

    def object_pose(self) -> NDArray[np.float64] | None:
        """Return the object's pose, (7,) position m and quaternion wxyz, None until it was seen."""
        record = self._object.latest()
        if record is None or not record["seen"][0]:
            return None
        return np.concatenate([record["position"][0], record["orientation_wxyz"][0]])

    def cameras(self) -> Mapping[str, str]:
        """Return the shared memory of the cameras of the run, by their names."""
        status = self._status[0]
        return {} if status is None or status.job is None else status.job.cameras

    def learn(self, status: Status) -> Status:
        """Take a status that an answer brought along, so that a page sees its own order at once; return it."""
        self._status = (status, time.monotonic(), None)
        return status

    def _watch_rings(self) -> None:
        loop = self.view.loop
        while not self._ending.wait(_SAMPLE_PERIOD_S):
            if self._number % _LOOP_EVERY == 0:
                loop = self._loop.view()
            now_ns = time.monotonic_ns()
            now_s = now_ns * 1e-9
            for record in self._event_reader.drain():
                self._event_count += 1
                self._events.append(_event(self._event_count, record))
            status, asked_s, unreachable = self._status
            job = None if status is None else status.job
            # arms that a job has only just opened have not met anything
            if job is not None and (job.number != self._job or job.state is JobState.STARTING):
                self._job = job.number
                for arm in self._arms.values():
                    arm.hit = None
            views = {side: arm.view(now_s) for side, arm in self._arms.items()}
            self._number += 1
            self._pictures[self._number % _PICTURES] = (self._number, now_ns)
            self.view = LiveView(
                *map(views.get, SIDES),
                state=self._state(status if unreachable is None else None, now_s),
                loop=loop,
                status=status,
                status_age_s=NEVER_S if asked_s is None else now_s - asked_s,
                unreachable=unreachable,
                event=self._events[-1] if self._events else None,
                desk=self._desk.views,
                places=self._places(),
                number=self._number,
            )
            self.document = msgspec.json.encode(self.view)

    def _places(self) -> Places | None:
        known = (self.measured(), self.command(), self.object_pose())
        pads, told, lies = (None if poses is None else poses.round(4).tolist() for poses in known)
        return None if pads is None else Places(pads, told, lies)

    def _state(self, status: Status | None, now_s: float) -> CellState:
        places = self.measured()
        self._squeeze.add(None if places is None else places[:, :3], self.forces())
        arms = self._arms.values()
        job = status.job if status is not None else None
        if job is None or job.state is JobState.STARTING or not job.active:
            self._runs_since = None
        elif self._runs_since is None or self._runs_since[0] != job.number:
            self._runs_since = job.number, now_s
        led = self._runs_since is not None and all(arm.changed_s > self._runs_since[1] for arm in arms)
        return cell_state(status, led, any(now_s - arm.moved_s < MOVED_S for arm in arms), self._squeeze.held_n)

    def _watch_status(self) -> None:
        while not self._ending.wait(_STATUS_PERIOD_S):
            status, began_s = self._status[0], time.monotonic()
            holder = status.holder if status is not None else None
            heard = self._heartbeats.heard(holder)
            try:
                answer = self._client.beat(holder) if holder and heard else self._client.status()
                if began_s > (self._status[1] or 0.0):  # else what `learn` took meanwhile is newer
                    self._status = (answer, time.monotonic(), None)
            except (RobotUnreachable, RobotRefused) as error:
                status, asked_s, _ = self._status
                self._status = (status, asked_s, self._ended or str(error))


def _all(values: list[NDArray[np.float64] | None]) -> NDArray[np.float64] | None:
    return None if any(value is None for value in values) else np.array(values)


def _event(number: int, record: Any) -> EventView:
    level, (name, text) = int(record["level"]), (record[key].decode("ascii", "replace") for key in ("name", "text"))
    severity = Level(level).name if level in Level._value2member_map_ else "INFO"
    return EventView(number, float(record["t_ns"]) * 1e-9, time.time(), severity, name, text)
