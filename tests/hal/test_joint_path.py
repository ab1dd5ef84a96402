"""The way of both arms in joint space."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hal.joint_path import JointPath, JointSpeed

postures = arrays(np.float64, (2, 7), elements=st.floats(-2.0, 2.0))


@given(postures, postures, st.floats(0.05, 1.0), st.floats(0.1, 5.0))
def test_no_joint_is_faster_than_the_limit_and_both_arms_arrive_together(start, goal, speed, acceleration):
    path = JointPath.between(start, goal, JointSpeed(speed, acceleration))
    assert np.array_equal(path.at(0.0), start) or path.duration_s == 0.0
    assert path.at(path.duration_s) == pytest.approx(goal, abs=1e-12)
    assert path.at(path.duration_s + 1.0) == pytest.approx(goal, abs=1e-12)
    if path.duration_s < 1e-3:
        return
    step_s = path.duration_s / 400
    q = np.array([path.at(k * step_s) for k in range(401)])
    dq = np.diff(q, axis=0) / step_s
    ddq = np.diff(dq, axis=0) / step_s
    assert np.abs(dq).max() <= speed * 1.001
    assert np.abs(ddq).max() <= acceleration * 1.01
    # and it is the quickest such way: one of the limits is met
    assert np.abs(dq).max() > 0.98 * speed or np.abs(ddq).max() > 0.98 * acceleration


def test_nowhere_to_go_takes_no_time():
    here = np.full((2, 7), 0.3)
    path = JointPath.between(here, here, JointSpeed(0.4, 1.0))
    assert path.duration_s == 0.0
    assert np.array_equal(path.at(0.0), here)
