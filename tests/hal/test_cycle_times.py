"""Cycles of a real socket: when the kernel got what waits there, and how many of it wait."""

import select
import socket
import threading
import time

import numpy as np
import pytest

from hal.fci.cycle_times import LATE_NS, CycleTimes
from hal.fci.peeked_state import PeekedState, stamp_arrivals
from hal.host_work import EVERY, HostWork
from hal.state import ARM_STATE, ArmState, RobotMode
from hal.wire import ROBOT_STATE

TICK_NS = 1_000_000


@pytest.fixture
def wire():
    """A robot's socket and ours, of which the kernel stamps what arrives."""
    with socket.socket(type=socket.SOCK_DGRAM) as robot, socket.socket(type=socket.SOCK_DGRAM) as ours:
        ours.bind(("127.0.0.1", 0))
        ours.settimeout(60.0)
        robot.connect(ours.getsockname())
        stamp_arrivals(ours.fileno())
        yield robot, ours


def send(robot: socket.socket, number: int) -> tuple[int, int]:
    """Send a state; return the times before and after."""
    before = time.monotonic_ns()
    robot.send(number.to_bytes(8, "little") + bytes(1369))
    return before, time.monotonic_ns()


def test_a_state_that_waited_in_the_socket_has_the_kernels_time(wire):
    robot, ours = wire
    peeked = PeekedState()
    cycles = CycleTimes(peeked)
    for number in (7, 8):  # a socket's first stamp may be that of the first look
        before, after = send(robot, number)
        time.sleep(2e-3)
        slept = time.monotonic_ns()
        peeked.look(ours.fileno())
        looked = time.monotonic_ns()
        assert ours.recv(2000)[0] == number  # nothing was taken out
        cycles.read()
        cycles.answer(number * TICK_NS)
    cycle = cycles.sample[0]
    assert before - 1000 <= 1e3 * cycle["arrived_us"] <= looked
    assert cycle["unread"] == 1
    assert cycle["seen_us"] >= 1e-3 * (slept - after) - 1.0
    assert cycle["seen_us"] <= cycle["read_us"] <= cycle["answered_us"]
    assert cycles.late  # it has waited for longer than LATE_NS
    assert LATE_NS < 2e6


def test_a_state_is_taken_from_its_datagram(wire):
    robot, ours = wire
    told, taken = np.zeros((), ROBOT_STATE), ArmState.empty()
    for place, name in enumerate(ROBOT_STATE.names or ()):
        told[name] = np.arange(told[name].size).reshape(told[name].shape) + place
    told["message_id"], told["robot_mode"], told["errors"] = 4711, RobotMode.MOVE, 0
    peeked = PeekedState(taken)
    robot.send(told.tobytes())
    select.select([ours], [], [], 60.0)
    peeked.look(ours.fileno())
    assert peeked.take(4712) == -1  # libfranka has read a newer one
    assert taken.record.tobytes() == ArmState.empty().record.tobytes()
    assert peeked.take(4711) == RobotMode.MOVE
    record = taken.record[0]
    assert (record["t_ns"], record["robot_mode"], record["current_errors"]) == (4711 * TICK_NS, RobotMode.MOVE, 0)
    for name in set(ARM_STATE.names or ()) - {"t_ns", "robot_mode", "current_errors", "O_T_EE"}:
        assert np.array_equal(record[name], told[name].astype(float)), name
    assert np.array_equal(record["O_T_EE"], told["O_T_EE"].reshape(4, 4).T)
    told["errors"][7], told["message_id"] = 1, 4713
    robot.send(told.tobytes())
    ours.recv(2000)
    peeked.look(ours.fileno())
    assert peeked.take(4713) == -1  # libfranka names the errors


def test_of_several_states_the_oldest_counts(wire):
    robot, ours = wire
    peeked = PeekedState()
    cycles = CycleTimes(peeked)
    before, _ = send(robot, 100)
    for number in (101, 102, 103):
        send(robot, number)
    peeked.look(ours.fileno())
    for _ in range(4):
        ours.recv(2000)
    cycles.read()
    cycles.answer(103 * TICK_NS)
    assert cycles.sample["unread"][0] == 4
    assert 1e3 * cycles.sample["arrived_us"][0] >= before - 1000


def test_a_gap_in_the_robots_time_is_late_though_its_answer_is_quick(wire):
    robot, ours = wire
    peeked, late = PeekedState(), []
    cycles = CycleTimes(peeked)
    for number in (5, 6, 9):
        send(robot, number)
        peeked.look(ours.fileno())
        ours.recv(2000)
        cycles.answer(number * TICK_NS)
        late.append(cycles.late)
    assert late[2]


def test_the_hosts_counters_are_read_after_a_late_cycle_and_now_and_then():
    with HostWork() as work:
        read = [work.cycle(late=False) for _ in range(2 * EVERY)]
        assert [k for k, yes in enumerate(read) if yes] == [EVERY - 1, 2 * EVERY - 1]
        assert work.sample["cycles"][0] == EVERY
        assert work.cycle(late=True)
        assert work.sample["cycles"][0] == 1


def test_what_this_thread_computes_is_its_own_and_what_another_one_does_is_not():
    with HostWork() as work:
        began = time.thread_time_ns()
        while time.thread_time_ns() < began + 20_000_000:
            pass
        assert work.cycle(late=True)
        assert work.sample["cpu_us"][0] >= 20_000.0

        def compute() -> None:
            began = time.thread_time_ns()
            while time.thread_time_ns() < began + 20_000_000:
                pass

        other = threading.Thread(target=compute)
        other.start()
        other.join()
        assert work.cycle(late=True)
        assert work.sample["others_us"][0] >= 20_000.0


def test_a_collection_in_another_thread_is_counted():
    import gc

    with HostWork() as work:
        other = threading.Thread(target=gc.collect)
        other.start()
        other.join()
        work.cycle(late=True)
        assert work.sample["collected_us"][0] > 0.0
    assert work._collect not in gc.callbacks
