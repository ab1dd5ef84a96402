"""Stepping: who advances the plant, and what happens to milliseconds that nobody answered."""

import time

import numpy as np
import pytest

from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.clock import PERIOD_NS, PacedLockstep, RealtimeClock

NO_TORQUE = np.zeros(7)


class LateClock:
    """A clock whose waits were planned."""

    def __init__(self, plan: list[int]) -> None:
        self.missed = 0
        self._plan = iter(plan)

    def wait(self) -> int:
        milliseconds = next(self._plan)
        self.missed += milliseconds - 1
        return milliseconds


def test_either_arm_may_be_served_first() -> None:
    def run(order: tuple[str, str]) -> SimulatedCell:
        cell = simulated_cell("rice_box", 0.0, seed=1)
        torques = {"left": np.full(7, 0.5), "right": np.full(7, -0.3)}
        for _ in range(50):
            for side in order:
                arm = getattr(cell, side)
                arm.read()
                arm.write(torques[side])
        return cell

    one, other = run(("left", "right")), run(("right", "left"))
    assert np.array_equal(one.states, other.states)
    assert one.plant.ticks == 49


def test_both_arms_read_the_same_instant_and_own_their_states() -> None:
    cell = simulated_cell("rice_box", 0.0, seed=1)
    for tick in range(5):
        left = cell.left.read()
        right = cell.right.read()
        assert left.t_ns == right.t_ns == tick * 1_000_000
    held = right.record.copy()
    cell.left.read()
    assert np.array_equal(right.record, held)  # the other arm's read does not overwrite it


def test_a_missed_deadline_holds_the_last_torque_and_the_late_one_counts_afterwards() -> None:
    def applied(plan: list[int]) -> tuple[list[int], list[float]]:
        cell = simulated_cell("rice_box", 0.0, seed=1, clock=LateClock(plan))
        times, torques = [], []
        hold = cell.plant.advance

        def spied() -> None:
            torques.append(float(cell.plant.motors["tau_command"][0, 0]))
            hold()

        cell.plant.advance = spied
        for tick in range(len(plan) + 1):
            times.append(cell.left.read().t_ns // 1_000_000)
            cell.left.write(np.full(7, 0.1 * tick))
        return times, torques

    times, torques = applied([1, 1, 3, 1])
    assert times == [0, 1, 2, 5, 6]
    assert np.allclose(torques, [0.0, 0.1, 0.1, 0.1, 0.2, 0.3])


def test_lost_commands_lower_the_success_rate() -> None:
    clock = LateClock([1, 11, 1])
    cell = simulated_cell("rice_box", 0.0, seed=1, clock=clock)
    rates = []
    for _ in range(4):
        rates.append(cell.left.read().record["control_command_success_rate"][0])
        cell.left.write(NO_TORQUE)
    assert rates == [0.0, 1.0, 0.9, 0.9]
    assert clock.missed == 10


def test_the_real_time_clock_is_never_early_and_counts_what_it_missed() -> None:
    clock = RealtimeClock()
    start = time.monotonic_ns()
    passed = sum(clock.wait() for _ in range(30))
    assert time.monotonic_ns() - start >= 30 * 1_000_000
    assert passed == 30 + clock.missed


def test_a_long_pause_is_not_caught_up_in_full(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = RealtimeClock()
    clock.wait()
    now = time.monotonic_ns() + 60_000_000_000
    monkeypatch.setattr("sim_robot.clock.time.monotonic_ns", lambda: now)
    assert clock.wait() == 1001
    assert clock.missed >= 59_000


@pytest.mark.parametrize(("busy_ms", "period_ms"), [(0.3, 1.0), (0.85, 1.0), (2.0, 2.2), (30.0, 31.0)])
def test_whoever_waits_for_the_paced_clock_rests_even_when_it_is_late(monkeypatch, busy_ms, period_ms) -> None:
    now_ns, slept_ns = 0, 0

    def monotonic_ns() -> int:
        nonlocal now_ns
        now_ns += 100
        return now_ns

    def sleep(duration_s: float) -> None:
        nonlocal now_ns, slept_ns
        now_ns += round(1e9 * duration_s)
        slept_ns += round(1e9 * duration_s)

    monkeypatch.setattr("sim_robot.clock.time.monotonic_ns", monotonic_ns)
    monkeypatch.setattr("sim_robot.clock.time.sleep", sleep)
    clock = PacedLockstep()
    for _ in range(100):
        now_ns += round(1e6 * busy_ms)
        assert clock.wait() == 1
    assert now_ns / 100 == pytest.approx(period_ms * PERIOD_NS, rel=0.01)
    assert slept_ns >= 0.03 * now_ns
