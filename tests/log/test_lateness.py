"""Who was late: cycles made by a small model of robot, wire and host, each of them held up in its cycle."""

from collections.abc import Callable

import numpy as np
import pytest

from hal.cycle import CYCLE, WORK
from rtstack.log.analysis.lateness import Blame, HostCause, Lateness, lateness

MS = 1000.0  # us
HOST_CLOCK_US = 5e9  # what it shows when the robot shows 0
STATE = np.dtype([("t_ns", "i8"), ("control_command_success_rate", "f8")])
WAY_US, TICK_US = 30.0, 120.0
Held = Callable[[float], float]  # until when (us) what would happen then is held up


def at_once(t_us: float) -> float:
    """Nothing is held up."""
    return t_us


def held(begin_us: float, for_us: float) -> Held:
    """All between two moments waits for the second one."""
    return lambda t_us: begin_us + for_us if begin_us <= t_us < begin_us + for_us else t_us


def run(
    ticks: int = 1200, robot: Held = at_once, wire: Held = at_once, back: Held = at_once, host: Held = at_once,
    lost: frozenset[int] = frozenset(), skipped: frozenset[int] = frozenset(),
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return cycles and states of one arm. lost: numbers of states that the wire loses; skipped: that are not made.

    A robot that was held up goes on when it has its answer, as ours does; its clock then has made up for it.
    """
    sent, rates, missed = {}, {}, []
    cycles, states = [], []
    answered: dict[int, float] = {}  # state: when its answer is at the robot
    waiting: list[tuple[float, int]] = []
    free_us = 0.0
    for number in range(ticks):
        if number in skipped:
            continue
        at_us = robot(number * MS)
        if number and number - 1 not in skipped:
            begin = sent.get(number - 1, 0.0)
            missed.append(not answered.get(number - 1, np.inf) <= max(at_us, begin + MS))
        sent[number], rates[number] = at_us, 1.0 - sum(missed[-100:]) / 100.0
        if number not in lost:
            waiting.append((wire(at_us) + WAY_US, number))
        # the host serves what has come before the next state is sent
        next_us = robot((number + 1) * MS)
        while waiting:
            looks_us = host(max(free_us, waiting[0][0]))
            if looks_us >= next_us:
                break
            there = [one for one in waiting if one[0] <= looks_us]
            waiting = waiting[len(there) :]
            (oldest_us, oldest), (_, newest) = there[0], there[-1]
            done_us = host(looks_us + TICK_US)
            since = [at - oldest_us for at in (free_us, looks_us, looks_us + 10.0, done_us)]
            cycles.append((newest * 1_000_000, HOST_CLOCK_US + oldest_us, newest - oldest + 1, *since))
            states.append((newest * 1_000_000, rates[newest]))
            answered[newest] = back(done_us) + WAY_US
            free_us = done_us
    return np.array(cycles, CYCLE), np.array(states, STATE)


RIGHT = run()


def judged(*one: np.ndarray, work: np.ndarray | None = None) -> Lateness:
    """Return who was late, with a right arm that never is."""
    cycles, states = one
    return lateness((cycles, RIGHT[0]), (states, RIGHT[1]), np.zeros(0, WORK) if work is None else work)


def test_a_quiet_run_has_no_late_cycle():
    found = judged(*run())
    assert found.late == ()
    assert found.cycles == 2400
    assert found.line == "none of 2400 cycles was late"


@pytest.mark.parametrize("ms", [1.5, 3.0, 5.2, 12.0])
@pytest.mark.parametrize("at_us", [700_100.0, 700_020.0, 700_500.0])
def test_each_side_is_found(ms: float, at_us: float):
    stall = held(at_us, ms * MS)
    for name, cycles, blame in (("wire", run(wire=stall), Blame.WIRE), ("host", run(host=stall), Blame.HOST)):
        found = judged(*cycles)
        blamed = {cycle.blame for cycle in found.late}
        # a stall between two cycles that holds up none of them by a whole period may leave no late one
        assert blamed == {blame} or (not blamed and ms < 2.0), (name, found.late)


@pytest.mark.parametrize("ms", [1, 3, 8])
def test_a_robot_whose_clock_stands_still_is_late_once(ms: int):
    found = judged(*run(robot=lambda t_us: t_us + (ms * MS + 200.0 if t_us >= 700 * MS else 0.0)))
    assert [cycle.blame for cycle in found.late] == [Blame.ROBOT]
    assert found.late[0].outside_us == pytest.approx(ms * MS + 200.0, abs=1.0)
    assert found.late[0].unanswered == 0


def test_states_that_the_wire_loses_are_the_wires_and_those_never_made_are_the_robots():
    found = judged(*run(lost=frozenset(range(800, 805))))
    assert [(cycle.blame, cycle.missing) for cycle in found.late] == [(Blame.WIRE, 5)]
    found = judged(*run(skipped=frozenset(range(800, 805))))
    assert [(cycle.blame, cycle.missing) for cycle in found.late] == [(Blame.ROBOT, 5)]


def test_an_answer_that_left_in_time_and_was_not_taken_is_the_wires():
    found = judged(*run(back=held(700_100.0, 4 * MS)))
    assert found.late
    assert {cycle.blame for cycle in found.late} == {Blame.WIRE}


def test_a_robot_that_does_not_count_answers_leaves_robot_or_wire_open():
    cycles, states = run(wire=held(700_000.0, 5 * MS))
    states["control_command_success_rate"] = 0.0
    assert {cycle.blame for cycle in judged(cycles, states).late} == {Blame.ROBOT_OR_WIRE}


def counters(cycles: np.ndarray, late_at_us: float, **values: float) -> np.ndarray:
    """Return what was read each 16 cycles and after the first cycle that was answered after a moment."""
    answered = cycles["arrived_us"] + cycles["answered_us"]
    late = int(np.searchsorted(answered, HOST_CLOCK_US + late_at_us))
    rows = sorted({*range(15, len(cycles), 16), late})
    work = np.zeros(len(rows), WORK)
    work["at_us"] = answered[rows] + 2.0
    work["cycles"] = np.diff([-1, *rows])
    work["cpu_us"] = 200.0 * work["cycles"]
    for name, value in values.items():
        work[name][rows.index(late)] += value
    return work


@pytest.mark.parametrize(
    ("values", "at_us", "cause"),
    [
        ({"no_cpu_us": 4000.0}, 700_300.0, HostCause.NO_CPU),
        ({"collected_us": 4000.0, "others_us": 4000.0}, 700_300.0, HostCause.COLLECTION),
        ({"others_us": 4000.0}, 700_300.0, HostCause.THREAD),
        ({"cpu_us": 4000.0}, 700_100.0, HostCause.TICK),
        ({"cpu_us": 4000.0, "pages_read": 3.0}, 700_100.0, HostCause.PAGES),
        ({}, 700_300.0, HostCause.STOPPED),
    ],
)
def test_what_the_host_did_is_read_from_its_counters(values: dict[str, float], at_us: float, cause: HostCause):
    cycles, states = run(host=held(at_us, 4.5 * MS))
    found = judged(cycles, states, work=counters(cycles, at_us, **values))
    assert found.late[0].cause is cause  # the cycle after it may be late by it, too
    assert cause.value in found.causes
    assert found.late[0].late_us == pytest.approx(4.5 * MS, abs=700.0)


def test_two_clocks_that_drift_are_not_late():
    cycles, states = run(ticks=3000)
    cycles["arrived_us"] += 1e-4 * 1e-3 * cycles["t_ns"]  # 100 ppm
    assert judged(cycles, states).late == ()


def test_the_worst_come_first_and_the_parts_add_up():
    cycles, states = run(host=lambda t_us: held(700_100.0, 3 * MS)(held(900_100.0, 6 * MS)(t_us)))
    found = judged(cycles, states)
    worst = found.worst
    assert worst[0].late_us > worst[1].late_us
    assert set(found.shares) == {"HOST"}
    for cycle in worst:
        parts = cycle.outside_us + cycle.busy_us + cycle.wake_us + cycle.read_us + cycle.tick_us
        assert parts == pytest.approx(cycle.late_us, abs=0.5)
    late = len(found.late)
    assert found.line.startswith(f"{late} of {found.cycles} cycles late, in 2 stalls: {late} HOST")
    assert len(found.table) == 3
    assert found.as_dict()["worst"][0]["blame"] == "HOST"
