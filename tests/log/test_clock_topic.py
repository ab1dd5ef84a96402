"""Unix time of the robot's time, with drift and uncertainty, as a sample of the log."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

from hal.clock_relation import ClockRelation
from rtstack.cells.robot_clock import EVERY_NS, RobotClock
from rtstack.topics import CLOCK_TOPIC, TOPICS

DRIFT = 50e-6
SECONDS = 6


def test_a_sample_relates_the_robots_time_to_unix_time_ten_times_a_second():
    pair, relation = SimpleNamespace(left=SimpleNamespace(t_ns=0)), ClockRelation()
    clock, sample = RobotClock(pair, relation), np.zeros(1, TOPICS[CLOCK_TOPIC].record)
    sample["t_ns"] = -1
    clock.read(sample)
    assert sample["t_ns"][0] == -1  # nothing is known yet
    begun_ns, rng = time.monotonic_ns(), np.random.default_rng(0)
    for k in range(1000 * SECONDS):
        delay_ns = 100_000 + round(rng.exponential(50_000))
        relation.update(k * 1_000_000, begun_ns + round(k * 1e6 * (1.0 + DRIFT)) + delay_ns)
    clock._t_ns = (SECONDS * 1000 - 1) * 1_000_000
    low_ns = time.time_ns() - time.monotonic_ns()
    clock.read(sample)
    assert sample["t_ns"][0] == clock._t_ns
    assert sample["drift_ppm"][0] == pytest.approx(1e6 * DRIFT, abs=1.0)
    assert 0.0 < sample["uncertainty_us"][0] < 10.0
    assert sample["steps"][0] == 0
    at_ns = begun_ns + clock._t_ns * (1.0 + DRIFT) + 100_000  # the least delay belongs to it
    assert sample["unix_ns"][0] - low_ns == pytest.approx(at_ns, abs=1e6)
    clock._t_ns += EVERY_NS - 1_000_000
    clock.read(sample)
    assert sample["t_ns"][0] < clock._t_ns
    clock._t_ns += 1_000_000
    clock.read(sample)
    assert sample["t_ns"][0] == clock._t_ns
