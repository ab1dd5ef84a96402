"""Two clocks on one time line."""

import numpy as np
import pytest

from rtstack.loop.timeline import TICK_NS, Timeline
from rtstack.samples import TIMING_SAMPLE


def take(time: Timeline, side: int, t_ns: int, host_ns: int = 0) -> int:
    """Let the arm show a state; return the stamp that it gets."""
    stamps = np.array([t_ns], dtype=np.int64)
    time.take(side, stamps, host_ns)
    return int(stamps[0])


@pytest.fixture
def timing() -> np.ndarray:
    """The record that a time line keeps."""
    return np.zeros(1, TIMING_SAMPLE)


def test_the_second_clock_is_moved_onto_the_first_ones_time_line(timing):
    time = Timeline(timing, own_clocks=True)
    boot = 86_400_000 * TICK_NS  # the right box has been on for a day
    assert take(time, 0, 5 * TICK_NS) == 5 * TICK_NS
    assert not time.all_begun
    assert take(time, 1, boot) == 5 * TICK_NS
    assert time.all_begun
    for k in range(1, 100):
        take(time, 0, (5 + k) * TICK_NS)
        assert take(time, 1, boot + k * TICK_NS) == (5 + k) * TICK_NS
    assert (time.start_ns, time.now_ns, time.missed, time.skew_ns) == (5 * TICK_NS, 99 * TICK_NS, 0, 0)


def test_skew_and_missed_states_are_counted(timing):
    time = Timeline(timing, own_clocks=True)
    take(time, 0, 0)
    take(time, 1, 0)
    take(time, 0, TICK_NS)
    take(time, 1, 4 * TICK_NS)  # three states of the right arm were not seen
    assert time.missed == 3
    assert time.skew_ns == 3 * TICK_NS
    assert time.elapsed_ns == [TICK_NS, 4 * TICK_NS]
    take(time, 0, 2 * TICK_NS)
    assert timing["missed_deadlines"][0] == 3


def test_a_first_state_that_was_shown_several_times_is_one_tick_before_the_second(timing):
    time = Timeline(timing, own_clocks=False)
    for side, first in ((0, 7), (1, 6)):
        take(time, side, first * TICK_NS)
    for side in (0, 1):
        take(time, side, 10 * TICK_NS)
    assert time.elapsed_ns == [TICK_NS, TICK_NS]
    assert (time.start_ns, time.missed) == (9 * TICK_NS, 0)


def test_lateness_is_the_host_behind_the_robot(timing):
    time = Timeline(timing, own_clocks=True)
    take(time, 0, 0, host_ns=1_000)
    take(time, 0, TICK_NS, host_ns=1_251_000)
    assert timing["period_us"][0] == 1250.0
    assert timing["lateness_us"][0] == 250.0
    take(time, 0, 2 * TICK_NS, host_ns=2_001_000)
    assert timing["lateness_us"][0] == 0.0
    assert time.real_time_factor == 1.0


def test_the_arms_skew_is_the_time_between_their_newest_states(timing):
    time = Timeline(timing, own_clocks=True)
    take(time, 0, 0, host_ns=0)
    assert timing["pair_skew_us"][0] == 0.0
    take(time, 1, 0, host_ns=400_000)
    assert timing["pair_skew_us"][0] == 400.0
    take(time, 0, TICK_NS, host_ns=1_000_000)
    assert timing["pair_skew_us"][0] == 600.0


def test_arms_of_one_clock_have_no_skew(timing):
    time = Timeline(timing, own_clocks=False)
    for k in range(3):
        for side in (0, 1):
            take(time, side, k * TICK_NS, host_ns=k * 1_000_000 + side * 5_000)
            assert timing["pair_skew_us"][0] == 0.0


def test_a_pause_that_the_robot_bridges_is_kept_until_it_is_reported(timing):
    time = Timeline(timing, own_clocks=True)
    for t_ms in (0, 1, 4, 5):
        take(time, 0, t_ms * 1_000_000)
        take(time, 1, t_ms * 1_000_000)
    assert time.pause_ns == 0  # 3 ms is no pause yet
    for t_ms in (17, 18):
        take(time, 0, t_ms * 1_000_000)
        take(time, 1, t_ms * 1_000_000)
    assert time.pause_ns == 12_000_000
