"""The fit and the swing, against answers known beforehand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtstack.papers.impact_maps.evaluation import FitError, zero_feedback
from rtstack.papers.impact_maps.feedback import FeedbackSignal

SCALES = np.array([0.8, 0.9, 1.0, 1.1, 1.2])
speeds, slopes = st.floats(0.1, 1.0), st.floats(0.2, 3.0)


@given(speeds, slopes, st.sampled_from([-1.0, 1.0]), st.floats(0.7, 1.3))
def test_an_exact_line_gives_its_zero(truth, slope, sign, prediction):
    """The estimate does not depend on where the references were planned around."""
    planned = prediction * truth * np.repeat(SCALES, 5)
    fit = zero_feedback(planned.tolist(), (sign * slope * (planned - truth)).tolist())
    assert fit.estimate == pytest.approx(truth, rel=1e-9)
    assert fit.slope == pytest.approx(sign * slope, rel=1e-9)
    assert fit.r_squared == pytest.approx(1.0, abs=1e-9)
    assert fit.low == pytest.approx(truth, abs=1e-6)
    assert fit.high == pytest.approx(truth, abs=1e-6)
    assert fit.error_percent(1.02 * truth) == pytest.approx(2.0, abs=1e-6)


@given(speeds, slopes, st.floats(-0.05, 0.05))
def test_feedback_that_is_always_there_moves_the_estimate_by_its_share(truth, slope, bias):
    planned = truth * np.repeat(SCALES, 5)
    fit = zero_feedback(planned.tolist(), (slope * (planned - truth) + bias).tolist())
    assert fit.estimate == pytest.approx(truth - bias / slope, rel=1e-9, abs=1e-9)


def test_the_interval_covers_the_truth_as_often_as_it_says():
    rng, truth, covered = np.random.default_rng(1), 0.45, 0
    planned = truth * np.repeat(SCALES, 5)
    for _ in range(400):
        fit = zero_feedback(planned.tolist(), (1.1 * (planned - truth) + 0.01 * rng.standard_normal(25)).tolist())
        assert fit.low < fit.estimate < fit.high
        covered += fit.low <= truth <= fit.high
    assert 0.92 < covered / 400 < 0.98


def test_what_is_no_line_is_said_so():
    for velocities, net in (([0.5, 0.5], [0.1, 0.2]), ([0.4, 0.5], [0.1, 0.1]), ([0.4, 0.5], [0.1, float("nan")])):
        with pytest.raises(FitError):
            zero_feedback(velocities, net)
    assert zero_feedback([0.4, 0.5], [-0.1, 0.1]).low is None


@given(st.floats(0.0, 0.5), st.floats(3.9, 8.0), st.floats(0.0, 6.28))
def test_what_swings_at_the_end_of_the_window_is_told_whatever_its_phase(amplitude, hertz, phase):
    t = np.arange(-0.1, 0.6005, 1e-3)
    moving = np.where(t < 0.2, 3.0 * t, 0.6) + amplitude * np.sin(2 * np.pi * hertz * t + phase)
    signal = FeedbackSignal(t, t, t, t, moving, True)
    assert signal.swing == pytest.approx(amplitude, rel=0.06, abs=1e-9)  # 3.9 Hz: nearly a period
    assert signal.net == moving[-1]
    assert abs(signal.net_over_swing - 0.6) < 0.22 * amplitude + 1e-3  # 0.217: the second lobe of sin x / x
