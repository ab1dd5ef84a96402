"""Two control boxes with two clocks on one plant, through the real client."""

import numpy as np
import pytest

from sim_robot.fci.__main__ import main
from sim_robot.fci.realtime import RightClock
from tests.programs.answer_times import hold_both


@pytest.mark.realtime
def test_each_arm_counts_by_its_own_clock_and_loses_nothing_to_the_other_ones_phase(fresh_server) -> None:
    """A link that lost 20 packets would raise. Whatever the host's pace, the right arm counts 1000 ppm more."""
    with fresh_server("--phase-us", "500", "--drift-ppm", "1000") as served:
        record = hold_both(served, 4000)
    for ids, rates in zip(record.message_ids, record.success_rates, strict=True):
        assert np.diff(ids).min() >= 1
        assert np.median(rates) >= 0.95
    (left, right), (left_ns, right_ns) = record.message_ids, record.came_ns
    common = (left_ns > right_ns[0]) & (left_ns < right_ns[-1])
    ahead = np.interp(left_ns[common], right_ns, right) - left[common]
    drift = np.polyfit(left[common], ahead, 1)[0]
    assert drift == pytest.approx(1e-3, abs=4e-4)


@pytest.mark.alone  # a link that lost 20 packets would raise
def test_a_state_shows_the_torque_that_answered_the_one_before(fresh_server) -> None:
    """By each arm's own clock, where nothing was lost: a client starts its next torque from what the robot has."""
    with fresh_server("--phase-us", "500", "--drift-ppm", "50") as served:
        record = hold_both(served, 2000)
    for ids, rates, shown, answered in zip(
        record.message_ids, record.success_rates, record.shown, record.answered, strict=True
    ):
        nothing_lost = (np.diff(ids) == 1) & (rates[1:] == 1.0)
        assert nothing_lost.any()
        assert np.abs(shown[1:] - answered[:-1])[nothing_lost].max() < 1e-3


def test_a_clock_that_could_not_be(capsys: pytest.CaptureFixture) -> None:
    assert RightClock(0.0, 1000.0).period_ns == pytest.approx(999_000.999)
    for arguments in (["--phase-us", "1000"], ["--drift-ppm", "5000"], ["--lockstep", "--phase-us", "500"]):
        with pytest.raises(SystemExit):
            main(arguments)
    assert "lockstep" in capsys.readouterr().err
