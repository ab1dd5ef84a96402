"""The pace of the robot: 1 kHz by absolute deadlines, answered or not; one clock for both arms, or one each.

With a phase or a drift the right arm has a clock of its own, as two control boxes do. Modelled: each arm's states go
out, its message ids count, and its answers are due and are applied, at its own instants. Both share one plant, which
goes on with the left clock: what the right arm shows is at most one plant ms old (as the clocks drift apart, a plant
state is shown twice, or not at all, once in a while), and a torque of the right arm acts from the plant's next ms on.
Not modelled: transport delay, and jitter beyond the host's own.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from sim_robot.fci.server import Server
from sim_robot.fci.station import Station
from sim_robot.model import SIDES

PERIOD_NS = 1_000_000
# while the server is behind its own clock, a client still gets its whole millisecond to answer a state: what is caught
# up is what the client does not need
LONGEST_ANSWER_NS = PERIOD_NS
# of each ms, so that states go out on time: what timers and wake-ups may take
AWAKE_NS = 120_000
# the plant is not advanced before its time when somebody's states are due sooner than this
LONGEST_ADVANCE_NS = 300_000
# further behind than this, the robot's time slips instead of being caught up
LARGEST_LAG_NS = 50_000_000


@dataclass(frozen=True, slots=True)
class RightClock:
    """How the right arm's clock runs against the left one's: phase_us later at the start, drift_ppm faster."""

    phase_us: float = 0.0
    drift_ppm: float = 0.0

    def __post_init__(self) -> None:
        if not (0.0 <= self.phase_us < 1000.0 and abs(self.drift_ppm) <= 1000.0):
            raise ValueError("the phase is 0 to below 1000 us, the drift at most 1000 ppm either way")

    @property
    def period_ns(self) -> float:
        """The right arm's millisecond in ns of the left one's clock."""
        return PERIOD_NS / (1.0 + 1e-6 * self.drift_ppm)


class _BoxClock:
    """The instants of the stations of one clock. deadline_ns: the next one; shown_ns: when states went out last."""

    def __init__(self, stations: tuple[Station, ...], origin_ns: int, period_ns: float) -> None:
        self.stations, self.ticks, self.shown_ns = stations, 0, 0
        self._origin_ns, self._period_ns = origin_ns, period_ns

    @property
    def deadline_ns(self) -> int:
        return self._origin_ns + round((self.ticks + 1) * self._period_ns)

    def slip(self, lag_ns: int) -> None:
        self._origin_ns += lag_ns


class Realtime:
    """Serves until `stopped` says so. overruns: ticks that began over a period late; slipped_ns: time given up."""

    def __init__(self, server: Server, right_clock: RightClock | None = None) -> None:
        """Without a right_clock, or with one that is exactly the left one's, both arms share one."""
        self._server = server
        self._right = None if right_clock == RightClock() else right_clock
        self._plant_clock = _BoxClock(server.stations, 0, PERIOD_NS)
        self._ahead = False  # the plant has gone on already, and what it shows waits for its time
        self.ticks = self.overruns = 0
        self.slipped_ns = self.worst_lateness_ns = 0

    def run(self, stopped: Callable[[], bool]) -> None:
        """Serve both arms."""
        server, clock = self._server, time.monotonic_ns
        left, right = server.stations
        start = clock()
        if self._right is None:
            self._plant_clock = plant_clock = _BoxClock((left, right), start, PERIOD_NS)
            clocks = [plant_clock]
        else:
            right.box.own_clock = True
            self._plant_clock = plant_clock = _BoxClock((left,), start, PERIOD_NS)
            clocks = [
                plant_clock,
                _BoxClock((right,), start + round(1e3 * self._right.phase_us), self._right.period_ns),
            ]
        while not stopped():
            due = min(clocks, key=lambda one: one.deadline_ns)
            self._wait(due)
            lateness = clock() - due.deadline_ns
            if lateness > PERIOD_NS:
                self.overruns += 1
                self.worst_lateness_ns = max(self.worst_lateness_ns, lateness)
                if lateness > LARGEST_LAG_NS:
                    self.slipped_ns += lateness
                    for one in clocks:
                        one.slip(lateness)
            due.ticks += 1
            if due is plant_clock:
                self.ticks += 1
                if not self._ahead:
                    server.advance()
                self._ahead = False
                if self.ticks % 100 == 0:
                    server.show_grippers()
                    server.tidy(0.1)
            else:
                right.box.sample()
                right.settle_outcome()
            for station in due.stations:
                station.show_new()
            due.shown_ns = clock()

    def report(self) -> str:
        """How well the pace was kept, and one line an arm on how fast its client answered."""
        pace = (
            f"{self.ticks} ticks, {self.overruns} overruns (worst {1e-6 * self.worst_lateness_ns:.1f} ms late), "
            f"{1e-6 * self.slipped_ns:.1f} ms slipped"
        )
        arms = zip(SIDES, self._server.stations, strict=True)
        lines = (
            f"{side}: {station.answers.report()}; {int(station.motion['beyond'])} targets beyond the published limits"
            for side, station in arms
        )
        return "\n".join([pace, *lines])

    def _look_ahead(self, left_ns: int) -> None:
        """Advance the plant as soon as nothing can change its next ms any more: its states then go out on time."""
        stations = self._plant_clock.stations
        if self._ahead or left_ns < LONGEST_ADVANCE_NS or any(station.awaited for station in stations):
            return
        self._server.advance()
        self._ahead = True

    def _wait(self, due: _BoxClock) -> None:
        """Take answers and requests until the deadline; when late, only until its moving arms have answered."""
        server, clock = self._server, time.monotonic_ns
        while True:
            now = clock()
            left = due.deadline_ns - now
            if left <= 0:
                left = due.shown_ns + LONGEST_ANSWER_NS - now
                if left <= 0 or not any(station.awaited for station in due.stations):
                    server.poller.serve(0.0)
                    return
            # the last of it awake: a thread that sleeps is woken late
            self._look_ahead(left)
            server.poller.serve(max(0, due.deadline_ns - clock() - AWAKE_NS) * 1e-9)
