"""The low-pass of the commanded torque."""

import math

import numpy as np
import pytest

from rtstack.control.records import WORKSPACE
from rtstack.loop.low_pass import low_pass, low_pass_share
from rtstack.samples import ARM_SAMPLE


def test_it_is_off_by_default_and_a_low_cutoff_is_slow():
    assert low_pass_share(0.0) == 1.0
    assert low_pass_share(100.0) == pytest.approx(1e-3 / (1e-3 + 1.0 / (2.0 * math.pi * 100.0)))
    assert low_pass_share(10.0) < low_pass_share(100.0) < 1.0


def test_a_step_is_approached_and_never_passed():
    sample, work = np.zeros(1, ARM_SAMPLE), np.zeros(1, WORKSPACE)
    share = low_pass_share(50.0)
    last = 0.0
    for k in range(1, 40):
        sample["tau_desired"][0] = 0.8
        low_pass(sample, work, share)
        tau = float(sample["tau_desired"][0, 3])
        assert last < tau < 0.8
        assert tau == pytest.approx(0.8 * (1.0 - (1.0 - share) ** k))
        work["tau_previous"][0] = sample["tau_desired"][0]
        last = tau


def test_what_is_no_number_is_left_to_the_judge():
    sample, work = np.zeros(1, ARM_SAMPLE), np.zeros(1, WORKSPACE)
    sample["tau_desired"][0, 2] = np.nan
    low_pass(sample, work, 0.3)
    assert np.isnan(sample["tau_desired"][0, 2])
