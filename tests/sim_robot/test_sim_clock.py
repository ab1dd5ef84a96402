"""Stepping: who advances the plant, and how it is paced."""

import numpy as np
import pytest

from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.clock import PERIOD_NS, PacedLockstep

NO_TORQUE = np.zeros(7)


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
        clock.wait()
    assert now_ns / 100 == pytest.approx(period_ms * PERIOD_NS, rel=0.01)
    assert slept_ns >= 0.03 * now_ns
