"""The pace of the robot: 1 kHz by absolute deadlines, answered or not; one clock for all arms, or one each.

With a phase or a drift the right arm has a clock of its own: its states, ids and answers are due at its own instants.
Both share one plant, which goes on with the left clock: what the right arm shows is at most one plant ms old, and its
torque acts from the plant's next ms on. A twin's profile delays states (link_late_us). `pace.py`: who may be late.
"""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from sim_robot.fci.arm_server import ArmServer
from sim_robot.fci.pace import LONGEST_SILENCE, PERIOD_NS, Pace
from sim_robot.fci.server import Server

# of each ms, so that states go out on time: what timers and wake-ups may take
AWAKE_NS = 120_000
# the plant is not advanced before its time when a client's states are due sooner than this
LONGEST_ADVANCE_NS = 300_000
STALLS_SAID = 20


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


class _BoxClock(Pace):
    """The pace of the arm_servers of one clock."""

    def __init__(self, arm_servers: tuple[ArmServer, ...], origin_ns: int, period_ns: float = PERIOD_NS) -> None:
        super().__init__(origin_ns, period_ns)
        self.arm_servers = arm_servers

    def ends_ns(self) -> int:
        awaited = [arm_server for arm_server in self.arm_servers if arm_server.awaited]
        return self.end_ns(bool(awaited), any(arm_server.punctual for arm_server in awaited))


class Realtime:
    """Serves until `stopped` says so. stalls: how often the server was over a period late by itself."""

    def __init__(self, server: Server, right_clock: RightClock | None = None, slower: float = 1.0) -> None:
        """right_clock: None, or exactly the left one's, for one clock. slower: so many times slower than real time."""
        self._server = server
        self._slower, self._period_ns = slower, round(slower * PERIOD_NS)
        for arm_server in server.arm_servers:
            arm_server.period_ns = self._period_ns
            arm_server.link.be_late(*arm_server.link_late())
        self._right = None if right_clock == RightClock() else right_clock
        self._clocks: tuple[_BoxClock, ...] = (_BoxClock(server.arm_servers, 0),)
        self._ahead = False  # the plant has gone on already, and what it shows waits for its time
        self.ticks = self.stalls = self.worst_stall_ns = 0
        self._last_stalls: deque[str] = deque(maxlen=STALLS_SAID)

    def run(self, stopped: Callable[[], bool]) -> None:
        server, clock = self._server, time.monotonic_ns
        start = clock()
        if self._right is None:
            self._clocks = (_BoxClock(server.arm_servers, start, self._period_ns),)
        else:
            left, right = server.arm_servers
            right.box.own_clock = True
            later = start + round(1e3 * self._right.phase_us)
            period_ns = self._slower * self._right.period_ns
            self._clocks = (_BoxClock((left,), start, self._period_ns), _BoxClock((right,), later, period_ns))
        plant_clock = self._clocks[0]
        while not stopped():
            due, expected_ns = self._wait()
            due.begin(clock())
            if due is plant_clock:
                self.ticks += 1
                server.look_at_desk()
                if not self._ahead:
                    server.advance()
                self._ahead = False
                server.settle_grippers()
                if self.ticks % 100 == 0:
                    server.show_grippers()
                    server.tidy(0.1)
            for arm_server in due.arm_servers:
                if due is not plant_clock:
                    arm_server.box.sample()
                    arm_server.settle_outcome()
                arm_server.show_new()
            now = clock()
            due.show(now)
            if now - expected_ns > self._period_ns:
                self._note_stall(now - expected_ns)
            to_epoch_ns = time.time_ns() - now
            for arm_server in due.arm_servers:
                arm_server.due_ns = to_epoch_ns + (due.window_ns if arm_server.punctual else due.deadline_ns)

    def _note_stall(self, late_ns: int) -> None:
        self.stalls += 1
        self.worst_stall_ns = max(self.worst_stall_ns, late_ns)
        ids = " and ".join(str(arm_server.message_id) for arm_server in self._server.arm_servers)
        self._last_stalls.append(f"{1e-6 * late_ns:.1f} ms before message {ids}")
        awaited = [arm_server for arm_server in self._server.arm_servers if arm_server.awaited]
        if not awaited or any(arm_server.silent < LONGEST_SILENCE for arm_server in awaited):
            for one in self._clocks:
                one.stand_still(late_ns)

    def report(self) -> str:
        """How well the pace was kept, and one line an arm on how fast its client answered."""
        slipped_ns = max(clock.slipped_ns for clock in self._clocks)
        pace = (
            f"{self.ticks} ticks, {self.stalls} stalls of this host (worst {1e-6 * self.worst_stall_ns:.1f} ms), "
            f"{1e-6 * slipped_ns:.1f} ms given up"
        )
        lines = (
            f"{side}: {server.answers.report()}; {int(server.motion['beyond'])} targets beyond the published limits"
            for side, server in zip(self._server.cell.scene.sides, self._server.arm_servers, strict=True)
        )
        stalls = [f"last stalls: {'; '.join(self._last_stalls)}"] if self._last_stalls else []
        return "\n".join([pace, *lines, *stalls])

    def _look_ahead(self, left_ns: int) -> None:
        """Advance the plant as soon as nothing can change its next ms any more: its states then go out on time."""
        arm_servers = self._clocks[0].arm_servers
        if self._ahead or left_ns < LONGEST_ADVANCE_NS or any(arm_server.awaited for arm_server in arm_servers):
            return
        self._server.advance()
        self._ahead = True

    def _wait(self) -> tuple[_BoxClock, int]:
        """Take answers and requests until a millisecond ends; return whose, and when that was to be expected."""
        server, clock = self._server, time.monotonic_ns
        expected_ns = None
        while True:
            now = clock()
            due, end_ns = self._clocks[0], self._clocks[0].ends_ns()
            for other in self._clocks[1:]:
                if other.ends_ns() < end_ns:
                    due, end_ns = other, other.ends_ns()
            if end_ns <= now:
                server.poller.serve(0.0)
                return due, now if expected_ns is None else min(now, expected_ns)
            expected_ns = end_ns
            # the last of it awake: a thread that sleeps is woken late
            self._look_ahead(end_ns - now)
            server.poller.serve(max(0, end_ns - clock() - AWAKE_NS) * 1e-9)
