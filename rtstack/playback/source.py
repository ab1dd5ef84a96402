"""Leads the arms along a log's path: writes the plan's only point each tick, at the pace of the playback. A watchdog:
it brakes softly on request, ends at rest, and has the judge stop the arms where a pad touches something."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rtstack.control.controller import ObservedArm
from rtstack.control.records import POINT
from rtstack.loop.end import End
from rtstack.loop.mailbox import TARGET, Mailbox
from rtstack.loop.watchdogs import Watchdog, WatchdogTrip
from rtstack.playback.path import brake, end_s, follow, write_point
from rtstack.samples import SIDES, Level, Mode
from rtstack.trials.run_context import SoftStop

# a force on a pad that lasts is contact, however slowly it grew. Ours: an arm's estimate is off by a few newtons in
# free motion (the simulated one's by 0.5 N in a grab without the object)
CONTACT_N = 20.0
CONTACT_TICKS = 20


class PlaybackSource(Watchdog):
    """Follows the stations of each arm, (n,) of STATION each, at a pace (1,) of PACE. points (arms, 1): the plan's."""

    def __init__(
        self, stations: Sequence[NDArray], paces: NDArray, soft_stop: SoftStop | None = None,
        sides: Sequence[str] = SIDES,
    ) -> None:  # fmt: skip
        self._sides = sides
        self.points = np.zeros((len(stations), 1), POINT)
        self.contact = ""  # which pad met something, and how
        self._stations = stations
        self._paces = paces
        self._soft_stop = soft_stop
        self._braking = self._unbegun = False  # a stop was asked for: after the first tick, before it
        self._end_s = end_s(paces)
        self._start_ns = [-1] * len(stations)
        self._t_s = [0.0] * len(stations)
        # views of single fields, looked up once: time, position, force
        nothing = np.zeros(0)
        self._seen: list[tuple[NDArray, NDArray, NDArray]] = [(nothing, nothing, nothing)] * len(stations)
        self._mode = [np.zeros(1, np.int64)] * len(stations)
        self._largest_square = 0.0
        self._pressed = [0] * len(stations)  # ticks for which a pad has felt a force
        self._moment, self._three, self._turn = np.zeros(3), np.zeros(3), np.zeros((3, 3))
        brake(paces.copy(), 0.0, self._moment)  # all is compiled before the first tick, and the points are at the start
        for side in range(len(stations)):
            self._write(side)

    @property
    def place_s(self) -> float:
        """Which moment of the log is played, s after its start."""
        moment = np.zeros(3)
        follow(self._paces, max(self._t_s), moment)
        return float(moment[0])

    @property
    def begun(self) -> bool:
        """Whether each arm has had its first tick."""
        return min(self._start_ns) >= 0

    @property
    def largest_error_m(self) -> float:
        """Largest distance of a pad from where it was to be, m."""
        return math.sqrt(self._largest_square)

    @property
    def share(self) -> float:
        """How much of the playback is over, 0 to 1."""
        return min(1.0, max(self._t_s) / self._end_s)

    def listen(self) -> None:
        """See rtstack.loop.session.PointSource: begin the last ramp once a soft stop is asked for."""
        if self._soft_stop is None or self._braking or not self._soft_stop.asked:
            return
        t_s = max(self._t_s)
        self._unbegun = not self.begun
        if self.begun and t_s < self._paces["brake_t"][0]:
            self._braking = True
            brake(self._paces, t_s, self._moment)
            self._end_s = end_s(self._paces)

    def trip(self) -> WatchdogTrip | None:
        if self.contact:
            return WatchdogTrip(End.CRASH, self.contact)
        if self._unbegun:
            return WatchdogTrip(End.STOP_REQUESTED, "before it began", Level.INFO)
        if min(self._t_s) < self._end_s:
            return None
        return WatchdogTrip(End.STOP_REQUESTED if self._braking else End.COMPLETED, "", Level.INFO)

    def step(self, side: int, arm: ObservedArm) -> None:
        """Write the point of this tick of an arm whose state was observed."""
        if self._start_ns[side] < 0:
            self._start_ns[side] = int(arm.sample["t_ns"][0])
            work = arm.workspace[0]
            self._seen[side] = arm.sample["t_ns"], work["position"], work["force_world"]
            self._mode[side] = arm.control["mode"]
        elif self._mode[side][0] == Mode.STOPPING:
            return  # the judge brakes: how far the log was played stays as it is
        stamp, position, force = self._seen[side]
        self._t_s[side] = (int(stamp[0]) - self._start_ns[side]) * 1e-9
        self._write(side)
        for i, wanted in enumerate(self.points["position"][side, 0]):
            self._three[i] = wanted - position[i]
        self._largest_square = max(self._largest_square, _square(self._three))
        pressed = _square(force) > CONTACT_N * CONTACT_N
        self._pressed[side] = self._pressed[side] + 1 if pressed else 0
        if (arm.impact or self._pressed[side] >= CONTACT_TICKS) and not self.contact:
            how = "was hit" if arm.impact else f"felt more than {CONTACT_N:g} N"
            self.contact = f"the {self._sides[side]} pad {how} at {self._moment[0]:.2f} s of the log"

    def _write(self, side: int) -> None:
        follow(self._paces, self._t_s[side], self._moment)
        write_point(self._stations[side], self._moment, self._three, self._turn, self.points[side])


def _square(three: NDArray) -> float:
    x, y, z = three
    return float(x * x + y * y + z * z)


class Finish:
    """Whether the operator of a job has asked for its soft end. A rtstack.trials.run_context.SoftStop."""

    def __init__(self, mailbox: Mailbox, job: int) -> None:
        self._mailbox = mailbox
        self._job = job
        self._sequence = mailbox.target_sequence
        self._target = np.zeros(1, TARGET)
        self._asked = False

    @property
    def asked(self) -> bool:
        """See SoftStop. A block that is being written is looked at again in the next tick."""
        sequence = self._mailbox.target_sequence
        if sequence != self._sequence and self._mailbox.read_target(self._target):
            self._sequence = sequence
            target = self._target[0]
            self._asked = self._asked or bool(target["finish"] and target["job"] == self._job)
        return self._asked
