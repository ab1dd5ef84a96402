"""The safety judge: what it lets through, what it limits, what it stops, and that a stop lasts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hal.limits import CONTROL_PERIOD_S
from hal.robots import FR3
from rtstack.safety.judge import Cause, Judgement, SafetyJudge
from rtstack.samples import ARM_SAMPLE

HOME = np.array([0.0, 0.0, 0.0, -1.6, 0.0, 2.0, 0.0])
STEP = FR3.limits.tau_rate_max * CONTROL_PERIOD_S


def _sample(q=HOME, dq=0.0, tau_desired=0.0, tau_J=0.0) -> np.ndarray:
    sample = np.zeros(1, ARM_SAMPLE)
    sample["q"][0], sample["dq"][0] = q, dq
    sample["tau_desired"][0], sample["tau_J"][0] = tau_desired, tau_J
    return sample


def test_an_ordinary_torque_passes_unchanged():
    judge, sample = SafetyJudge(), _sample(tau_desired=0.9)
    assert judge.judge(sample) is Judgement.PASS
    np.testing.assert_array_equal(sample["tau_applied"], sample["tau_desired"])
    assert judge.interventions == 0


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_torque_step_is_limited_to_the_rate(joint, sign):
    judge, sample = SafetyJudge(), _sample()
    sample["tau_desired"][0, joint] = sign * (STEP + 0.01)
    assert judge.judge(sample) is Judgement.LIMITED
    assert abs(sample["tau_applied"][0, joint]) <= STEP
    assert judge.joint == joint + 1
    assert judge.interventions == 1


@pytest.mark.parametrize("joint", range(7))
def test_torque_never_exceeds_its_limit(joint):
    judge, sample = SafetyJudge(), _sample()
    for tick in range(200):
        # now and then what it has: who wants too much without end is stopped
        wanted = FR3.limits.tau_max[joint] + 5.0 if tick % 3 else sample["tau_applied"][0, joint]
        sample["tau_desired"][0, joint] = wanted
        judge.judge(sample)
        assert sample["tau_applied"][0, joint] <= FR3.limits.tau_max[joint]
    assert sample["tau_applied"][0, joint] == FR3.limits.tau_max[joint]


def _broken(joint: int, what: str) -> tuple[np.ndarray, Cause]:
    sample = _sample()
    if what == "position_up":
        sample["q"][0, joint] = FR3.limits.q_upper[joint] - 0.004
        return sample, Cause.JOINT_POSITION
    if what == "position_down":
        sample["q"][0, joint] = FR3.limits.q_lower[joint] + 0.004
        return sample, Cause.JOINT_POSITION
    if what == "velocity":
        sample["dq"][0, joint] = FR3.limits.dq_max[joint] * 0.99
        return sample, Cause.JOINT_VELOCITY
    if what == "velocity_near_limit":
        # what the robot itself allows there, without the judge's margin
        sample["q"][0, joint] = FR3.limits.q_lower[joint] + 0.05
        sample["dq"][0, joint] = FR3.limits.dq_lower(sample["q"][0])[joint]
        return sample, Cause.JOINT_VELOCITY
    if what == "measured_torque":
        sample["tau_J"][0, joint] = -FR3.limits.tau_max[joint] - 0.01
        return sample, Cause.MEASURED_TORQUE
    sample[what][0, joint] = np.nan
    return sample, Cause.NOT_FINITE


BREAKS = [
    "position_up", "position_down", "velocity", "velocity_near_limit", "measured_torque", "q", "dq", "tau_J",
    "tau_desired",
]  # fmt: skip


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("what", BREAKS)
def test_each_violation_stops_and_latches(joint, what):
    judge = SafetyJudge()
    judge.judge(_sample())
    sample, reason = _broken(joint, what)
    assert judge.judge(sample) is Judgement.STOPPING
    assert (judge.reason, judge.joint) == (reason, joint + 1)
    assert np.all(np.isfinite(sample["tau_applied"]))
    good = _sample(tau_desired=0.5)
    assert judge.judge(good) is Judgement.STOPPING
    assert judge.interventions == 1


def test_a_commanded_stop_is_no_intervention_but_an_unsolved_qp_is():
    for demand, count in ((Cause.COMMANDED, 0), (Cause.CONTROLLER, 1)):
        judge = SafetyJudge()
        assert judge.judge(_sample(), demand) is Judgement.STOPPING
        assert judge.reason is demand
        assert judge.interventions == count


@given(
    seed=st.integers(0, 2**31),
    values=st.lists(
        st.sampled_from([0.0, -0.0, 1e-300, 86.9, 87.0, 1e9, -1e9, np.inf, -np.inf, np.nan]), min_size=7, max_size=7
    ),
)
def test_whatever_is_wanted_the_answer_is_finite_limited_and_continuous(seed, values):
    rng = np.random.default_rng(seed)
    judge, last = SafetyJudge(), np.zeros(7)
    for k in range(20):
        sample = _sample(q=HOME + 0.1 * rng.normal(size=7), dq=rng.normal(size=7))
        sample["tau_desired"][0] = values if k == 10 else 40.0 * rng.normal(size=7)
        judge.judge(sample)
        applied = sample["tau_applied"][0].copy()
        assert np.all(np.isfinite(applied))
        assert np.all(np.abs(applied) <= FR3.limits.tau_max)
        assert np.all(np.abs(applied - last) <= STEP)
        last = applied
