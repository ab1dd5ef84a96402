"""Who is late, the client or the server's host: the real server, arm_servers and plant on a clock that the test moves.

Only the sockets and the clock are the test's. Instants are in us from the start of the pace.
"""

import heapq
import itertools
from collections.abc import Callable

import numpy as np
import pytest

from hal.robot_errors import error_names
from hal.state import RobotMode
from hal.wire import ROBOT_COMMAND, ROBOT_STATE
from sim_robot.cell import simulated_cell
from sim_robot.fci import arm_server, realtime
from sim_robot.fci.drive import DrivenBox
from sim_robot.fci.protocol import Command
from sim_robot.fci.realtime import Realtime, RightClock
from sim_robot.fci.server import Server
from sim_robot.plant_parameters import load_plant_parameters
from tests.support.fci.server import addresses

US = 1_000
TORQUE_CONTROL = (2, 4, *(10.0, 3.12, 6.29) * 2, 0, *(0.0,) * 7)  # anywhere
COMMUNICATION = "communication_constraints_violation"


class Rig:
    """A server on the test's clock and wire. step_us: the plant's ms takes so long; wake_us: it wakes so late."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, step_us: int = 300, wake_us: int = 60) -> None:
        self.now_ns, self._step_ns, self._wake_ns = 1 << 50, step_us * US, wake_us * US
        self.start_ns = self.now_ns
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._count = itertools.count()
        self.stalls: dict[int, int] = {}  # in that ms of the plant the server is stopped for so many us
        for module in (realtime, arm_server):
            monkeypatch.setattr(module, "time", self)
        cell = simulated_cell("rice_box", 0.0, 0, box_kind=DrivenBox, on_the_wire=True)
        self.server = Server(cell, load_plant_parameters(), addresses())
        self._real_poller, self.server.poller = self.server.poller, self
        self._advance, self.server.advance = self.server.advance, self.advance
        self.wires = [Wire(self, one) for one in self.server.arm_servers]

    def monotonic_ns(self) -> int:
        self.now_ns += 2 * US  # who looks at the clock again and again gets on
        return self.now_ns

    def time_ns(self) -> int:
        return self.now_ns + (1 << 58)  # another epoch

    def advance(self) -> None:
        self._advance()
        self.now_ns += self._step_ns + US * self.stalls.get(self.server.cell.plant.ticks, 0)

    def at(self, instant_ns: int, act: Callable[[], None]) -> None:
        heapq.heappush(self._events, (instant_ns, next(self._count), act))

    def serve(self, timeout_s: float) -> bool:
        """What poller.serve does: what has come, or the first thing that comes, or the time is over."""
        until_ns = self.now_ns + round(1e9 * timeout_s)
        if not self._events or self._events[0][0] > until_ns:
            self.now_ns = until_ns + (self._wake_ns if timeout_s > 0.0 else 0)
        elif self._events[0][0] > self.now_ns:
            self.now_ns = self._events[0][0] + self._wake_ns
        while self._events and self._events[0][0] <= self.now_ns:
            heapq.heappop(self._events)[2]()
        return True

    def run(self, milliseconds: float, right_clock: RightClock | None = None) -> Realtime:
        """Let the server serve for so long."""
        pace, end_ns = Realtime(self.server, right_clock), self.now_ns + round(milliseconds * 1000 * US)
        pace.run(lambda: self.now_ns >= end_ns)
        return pace

    def close(self) -> None:
        self.server.poller = self._real_poller
        self.server.close()


class Wire:
    """What a arm_server takes for its link, with a client of torque control at the other end."""

    def __init__(self, rig: Rig, one: arm_server.ArmServer) -> None:
        self.client = object()
        self.arrived_ns = 0
        self._rig, self._arm_server = rig, one
        self._socket, one.link = one.link, self
        # how long the client takes to answer, us; from which state after Move on; and what it does not answer
        self.reaction_us, self.first, self.silence = 150, 0, range(0)
        self.copies, self.overtaken = 1, range(0)  # of each answer; and which are overtaken by the next one
        self.shown: list[tuple[int, int]] = []  # instants and message ids since Move
        self.moved = False

    def be_late(self, late_us, _seed):
        assert not len(late_us)  # as the cell has no twin's profile

    def move(self) -> None:
        self.moved = True
        self._arm_server.handle(Command.MOVE, 1, TORQUE_CONTROL)

    def send_state(self, state: memoryview) -> None:
        if not self.moved:
            return
        record = np.frombuffer(state, ROBOT_STATE)[0]
        nth, message_id = len(self.shown), int(record["message_id"])
        self.shown.append((self._rig.now_ns, message_id))
        if nth >= self.first and nth not in self.silence:
            instant_ns = self._rig.now_ns + US * (self.reaction_us + 1200 * (nth in self.overtaken))
            for _ in range(self.copies):
                self._rig.at(instant_ns, lambda: self.answer(message_id, instant_ns))

    def answer(self, message_id: int, instant_ns: int) -> None:
        command = np.zeros(1, ROBOT_COMMAND)
        command["message_id"] = message_id
        self.arrived_ns = instant_ns + (1 << 58)
        self._arm_server.take(command[0])

    def reply(self, *_: object) -> None:
        pass

    def close(self) -> None:
        self._socket.close()

    @property
    def errors(self) -> tuple[str, ...]:
        return error_names(self._arm_server.box.errors)

    @property
    def lost(self) -> int:
        return self._arm_server.answers.lost


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch):
    rigs = []

    def make(**kind: int) -> Rig:
        rigs.append(Rig(monkeypatch, **kind))
        return rigs[-1]

    yield make
    for one in rigs:
        one.close()


@pytest.mark.parametrize(("step_us", "wake_us"), [(100, 0), (300, 60), (300, 400), (800, 100)])
@pytest.mark.parametrize(
    ("silent_ms", "caught"), [(15, False), (18, False), (19, False), (21, True), (22, True), (25, True), (30, True)]
)
def test_a_silence(rig, silent_ms: int, caught: bool, step_us: int, wake_us: int) -> None:
    """A client that answers, sleeps for so long, and answers what it then finds, as one with a blocked loop does."""
    cell = rig(step_us=step_us, wake_us=wake_us)
    left = cell.wires[0]
    left.move()
    left.silence = range(50, 10_000)

    def wake_up() -> None:
        left.silence = range(50, len(left.shown))
        left.answer(left.shown[-1][1], cell.now_ns)

    cell.at(cell.start_ns + (50_000 + 150 + 1000 * silent_ms) * US, wake_up)
    pace = cell.run(150)
    assert left.errors == ((COMMUNICATION,) if caught else ())
    assert pace.stalls == 0
    assert abs(pace.ticks - 150) <= 1


def test_a_silent_arm_delays_neither_the_other_one_nor_the_clock(rig) -> None:
    cell = rig()
    left, right = cell.wires
    for wire in cell.wires:
        wire.move()
    left.silence = range(20, 35)
    cell.run(100)
    assert [round((instant - cell.start_ns) / 1e6) for instant, _ in right.shown] == list(
        range(1, len(right.shown) + 1)
    )
    assert (left.errors, right.errors) == ((), ())
    assert (left.lost, right.lost) == (15, 0)


@pytest.mark.parametrize(("reaction_us", "most_lost"), [(500, 0), (690, 0), (950, 50), (1100, 100)])
def test_a_slow_client_costs_packets_and_not_the_robots_time(rig, reaction_us: int, most_lost: int) -> None:
    cell = rig(wake_us=0)
    left = cell.wires[0]
    left.reaction_us = reaction_us
    left.move()
    pace = cell.run(100)
    assert abs(pace.ticks - 100) <= 2
    assert pace.stalls == 0
    assert left.lost <= most_lost


def test_answers_that_come_twice_count_once_and_one_that_is_overtaken_is_lost(rig) -> None:
    cell = rig()
    left = cell.wires[0]
    left.copies, left.overtaken = 2, range(30, 180, 10)
    left.move()
    pace = cell.run(200)
    assert left.errors == ()
    assert left.lost == len(left.overtaken)
    assert abs(pace.ticks - 200) <= 2


def test_who_was_late_once_is_served_again(rig) -> None:
    """One answer is lost; those after it come 0.9 ms after their states, which went out late by the plant's step."""
    cell = rig(wake_us=0)
    left = cell.wires[0]
    left.reaction_us, left.silence = 900, range(30, 31)
    left.move()
    cell.run(200)
    assert left.errors == ()
    assert left.lost < 110


def test_a_stall_of_the_server_is_not_the_clients(rig) -> None:
    cell = rig()
    left = cell.wires[0]
    left.move()
    cell.stalls = {40: 30_000}
    pace = cell.run(400)
    assert left.errors == ()
    assert left.lost == 0
    assert pace.stalls == 1
    assert pace.worst_stall_ns == pytest.approx(30e6, rel=0.1)
    assert abs(pace.ticks - 400) <= 1  # made up for


@pytest.mark.parametrize(("stall_ms", "silent", "caught"), [(30, 15, False), (30, 22, True), (5, 22, True)])
def test_a_stall_during_a_silence_does_not_count(rig, stall_ms: int, silent: int, caught: bool) -> None:
    cell = rig()
    left = cell.wires[0]
    left.move()
    left.silence = range(50, 50 + silent)  # states
    cell.stalls = {60: 1000 * stall_ms}
    pace = cell.run(200)
    assert pace.stalls == 1
    assert left.errors == ((COMMUNICATION,) if caught else ())


@pytest.mark.parametrize(("stalled_ms", "caught"), [(1, False), (10, True), (18, True)])
def test_who_is_silent_gains_no_time_by_a_stall(rig, stalled_ms: int, caught: bool) -> None:
    """A silence of 21 ms with a stall of 2 ms in it: at its beginning it may be the host's, later it is no excuse."""
    cell = rig()
    left = cell.wires[0]
    left.move()
    left.silence = range(50, 10_000)
    cell.stalls = {50 + stalled_ms: 2000}

    def wake_up() -> None:
        left.silence = range(50, len(left.shown))
        left.answer(left.shown[-1][1], cell.now_ns)

    cell.at(cell.start_ns + (50_000 + 150 + 21_000) * US, wake_up)
    pace = cell.run(150)
    assert pace.stalls == 1
    assert left.errors == ((COMMUNICATION,) if caught else ())


def test_an_answer_that_comes_during_a_stall_counts(rig) -> None:
    cell = rig()
    left = cell.wires[0]
    left.silence = range(29, 30)  # shown at 30 ms
    left.move()

    def stall() -> None:
        assert len(left.shown) == 30
        cell.now_ns += 5000 * US
        left.answer(left.shown[-1][1], cell.now_ns - 100 * US)

    cell.at(cell.start_ns + 30_500 * US, stall)
    pace = cell.run(60)
    assert pace.stalls == 1
    assert left.lost == 0


def test_a_long_stall_is_given_up(rig) -> None:
    cell = rig()
    cell.wires[0].move()
    cell.stalls = {40: 200_000}
    pace = cell.run(500)
    assert cell.wires[0].errors == ()
    assert abs(pace.ticks - 300) <= 2


@pytest.mark.parametrize(("first_ms", "caught"), [(0, False), (31, False), (900, False), (1100, True)])
def test_before_the_first_command_the_arm_is_held(rig, first_ms: int, caught: bool) -> None:
    """sim_robot/parameters/plant.toml: first_command_timeout_ms."""
    cell = rig(step_us=100)
    left = cell.wires[0]
    left.first = first_ms
    q = cell.server.cell.states[0]["q"].copy()
    left.move()
    cell.run(min(first_ms, 990))
    assert left.errors == ()
    assert cell.server.arm_servers[0].box.mode == RobotMode.MOVE
    assert cell.server.arm_servers[0].box.success_rate == 1.0
    assert np.abs(cell.server.cell.states[0]["q"] - q).max() < 1e-4
    cell.run(200)
    assert left.errors == ((COMMUNICATION,) if caught else ())


def test_after_the_first_command_twenty_are_enough(rig) -> None:
    cell = rig()
    left = cell.wires[0]
    left.first, left.silence = 31, range(32, 10_000)
    left.move()
    cell.run(50)  # the command came at 32 ms
    assert left.errors == ()
    cell.run(5)
    assert left.errors == (COMMUNICATION,)


def test_an_arm_with_a_clock_of_its_own(rig) -> None:
    cell = rig()
    left, right = cell.wires
    for wire in cell.wires:
        wire.move()
    left.silence = range(20, 35)
    cell.run(200, RightClock(phase_us=500.0))
    assert (left.errors, right.errors) == ((), ())
    assert right.lost == 0
    steps = np.diff([instant for instant, _ in right.shown])
    assert np.abs(steps - 1e6).max() < 0.45e6  # the plant's step for the left arm may come between
