"""The stop: a profile that stays inside the limits from wherever it begins, and holds what was held."""

from math import copysign, isnan, nan

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hal.robots import FR3
from rtstack.safety.judge import Cause, SafetyJudge
from rtstack.safety.limits import HARDWARE
from rtstack.safety.records import StopProfile
from tests.support.safety.judge_samples import HOME, arm_sample

# run as plain Python, numpy warns about inf - inf; compiled code does not
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")

BRAKING = np.maximum(FR3.limits.ddq_max, FR3.limits.deceleration)
GENTLE = 0.999


def test_the_braking_is_one_that_the_arm_has_and_that_its_velocity_limits_need():
    assert np.all(FR3.limits.deceleration <= BRAKING)
    assert SafetyJudge()._rules["braking"][0].tolist() == BRAKING.tolist() == [10, 10, 10, 10, 17, 10, 17]


@given(
    joint=st.integers(0, 6),
    where=st.one_of(st.sampled_from([0.0, 1.0, 0.001, 0.999]), st.floats(0.0, 1.0)),
    fast=st.one_of(st.sampled_from([-1.0, 1.0, 0.0]), st.floats(-1.0, 1.0)),
)
@settings(derandomize=True)
def test_from_any_state_inside_the_limits_a_stop_ends_inside_them(joint, where, fast):
    """A double integrator that follows the profile's velocity with the braking of its limits."""
    q, lower, upper = HOME.copy(), HARDWARE.q_lower[joint], HARDWARE.q_upper[joint]
    q[joint] = lower + where * (upper - lower)
    dq = np.zeros(7)
    room = upper - q[joint] if fast > 0 else q[joint] - lower
    allowed = np.sqrt(2 * FR3.limits.deceleration[joint] * room) - FR3.limits.velocity_offset[joint]
    dq[joint] = GENTLE * fast * min(HARDWARE.dq_max[joint], max(0.0, allowed))
    judge = SafetyJudge()
    judge.judge(arm_sample(0, q=q, dq=dq))
    assume(not judge.stopping)  # the end effector's speed has its own line
    for t_ms in range(1, 700):
        # the torque's rate lets the first braking act a tick later
        judge.judge(arm_sample(t_ms, q=q, dq=dq), Cause.COMMANDED)
        wanted = judge.memory["dq_hold"][0]
        step = np.clip(wanted - dq, -BRAKING * 1e-3, BRAKING * 1e-3)
        q = q + (dq + step / 2) * 1e-3
        dq = dq + step
        assert np.all((FR3.limits.q_lower <= q) & (q <= FR3.limits.q_upper))
        if t_ms > 5 and not dq.any():
            break
    assert not dq.any()
    np.testing.assert_allclose(judge.memory["q_hold"][0], q, atol=0.02)


def test_the_profile_is_the_one_that_is_stated():
    """Tick by tick: velocity less braking, position by it, torque by stiffness and damping about what was held."""
    judge, profile = SafetyJudge(), StopProfile()
    q, dq = HOME.copy(), np.array([1.0, -1.0, 0.5, -0.5, 0.3, -0.2, 0.0])
    held = np.array([0.5, -0.4, 0.3, -0.2, 0.1, -0.05, 0.0])
    judge.memory["tau_hold"], judge.memory["tau_applied"] = held, held
    velocity, place = dq.copy(), q.copy()
    last = held.copy()
    for t_ms in range(150):
        offset = 1e-4 * np.sin(t_ms + np.arange(7.0))
        sample = arm_sample(t_ms, q=q + offset, dq=dq)
        if t_ms == 0:
            place = q + offset
        judge.judge(sample, Cause.COMMANDED)
        velocity = np.sign(velocity) * np.maximum(0.0, np.abs(velocity) - BRAKING * 1e-3)
        place = place + velocity * 1e-3
        wanted = held + np.array(profile.stiffness) * (place - sample["q"][0])
        wanted += np.array(profile.damping) * (velocity - sample["dq"][0])
        step = 1.0 - 1e-4
        expected = np.clip(np.clip(wanted, -np.array(HARDWARE.tau_max), HARDWARE.tau_max), last - step, last + step)
        np.testing.assert_allclose(sample["tau_applied"][0], expected, atol=1e-9)
        np.testing.assert_allclose(judge.memory["q_hold"][0], place, atol=1e-12)
        last = sample["tau_applied"][0].copy()
        q, dq = q + 1e-3 * velocity, velocity + 0.001
    assert not velocity.any()
    assert not judge.memory["dq_hold"][0].any()


def test_the_hold_s_numbers_are_the_stated_ones():
    profile = StopProfile()
    assert profile.stiffness == (600.0, 600.0, 600.0, 600.0, 100.0, 80.0, 40.0)
    assert profile.damping == (30.0, 30.0, 30.0, 30.0, 6.0, 5.5, 4.0)
    assert (profile.reaction_s, profile.average_s) == (0.002, 0.02)


def test_what_is_held_is_the_mean_of_the_last_torques():
    judge = SafetyJudge()
    expected = 0.0
    for t_ms in range(80):
        tau = 0.5 * (1 + t_ms % 2)
        judge.judge(arm_sample(t_ms, tau_desired=tau))
        expected += 0.05 * (tau - expected)
    np.testing.assert_allclose(judge.memory["tau_hold"][0], expected, atol=1e-12)
    judge.judge(arm_sample(80, tau_desired=50.0), Cause.COMMANDED)
    np.testing.assert_allclose(judge.memory["tau_hold"][0], expected, atol=1e-12)


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_profile_ends_at_the_position_limit_and_does_not_pull_back(joint, sign):
    line = HARDWARE.q_upper[joint] if sign > 0 else HARDWARE.q_lower[joint]
    for beyond in (-0.001, 0.0, 0.01):
        judge = SafetyJudge()
        q, dq = HOME.copy(), np.zeros(7)
        q[joint], dq[joint] = line + sign * beyond, sign * 2.0
        for t_ms in range(5):
            judge.judge(arm_sample(t_ms, q=q, dq=dq))
        assert judge.reason is Cause.JOINT_POSITION
        assert judge.memory["q_hold"][0, joint] == line + sign * max(beyond, 0.0)
        assert judge.memory["dq_hold"][0, joint] == 0.0
        # one that comes back is braked where it comes to rest
        judge = SafetyJudge()
        dq[joint] = -sign * 1.0
        q[joint] = line + sign * 0.01
        judge.judge(arm_sample(0, q=q, dq=dq))
        assert judge.memory["q_hold"][0, joint] == pytest.approx(q[joint] - sign * (1.0 - BRAKING[joint] * 1e-3) * 1e-3)
        assert judge.memory["dq_hold"][0, joint] == pytest.approx(-sign * (1.0 - BRAKING[joint] * 1e-3))


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_profile_that_arrives_exactly_at_the_limit_is_not_beyond_it(joint, sign):
    line = HARDWARE.q_upper[joint] if sign > 0 else HARDWARE.q_lower[joint]
    speed = 1.0 - BRAKING[joint] * 1e-3
    judge = SafetyJudge()
    judge.judge(arm_sample(0), Cause.COMMANDED)
    place = line - sign * speed * 1e-3
    for candidate in (place, np.nextafter(place, -9.0), np.nextafter(place, 9.0)):
        if candidate + sign * speed * 1e-3 == line:
            place = candidate
    assert place + sign * speed * 1e-3 == line
    judge.memory["q_hold"][0, joint], judge.memory["dq_hold"][0, joint] = place, sign * 1.0
    judge.judge(arm_sample(1))
    assert (judge.memory["q_hold"][0, joint], judge.memory["dq_hold"][0, joint]) == (line, sign * speed)
    judge.judge(arm_sample(2))
    assert (judge.memory["q_hold"][0, joint], judge.memory["dq_hold"][0, joint]) == (line, 0.0)


def test_an_arm_whose_state_is_lost_brakes_from_where_it_was_last_seen():
    judge = SafetyJudge()
    judge.judge(arm_sample(0, q=HOME + 0.1, dq=0.5))
    judge.judge(arm_sample(1, q=nan, dq=nan))
    assert judge.reason is Cause.NOT_FINITE
    for i in range(7):
        speed = copysign(0.5 - BRAKING[i] * 1e-3, 1.0)
        assert judge.memory["dq_hold"][0, i] == pytest.approx(speed)
        assert judge.memory["q_hold"][0, i] == pytest.approx(HOME[i] + 0.1 + 1e-3 * speed)
    sample = arm_sample(2, q=nan, dq=nan)
    judge.judge(sample)
    assert sample["tau_applied"][0].tolist() == [0.0] * 7


def test_an_arm_that_was_never_seen_is_held_where_it_first_shows():
    judge = SafetyJudge()
    sample = arm_sample(0, q=nan, dq=nan)
    judge.judge(sample)
    assert sample["tau_applied"][0].tolist() == [0.0] * 7
    assert all(isnan(q) for q in judge.memory["q_hold"][0])
    judge.judge(arm_sample(1))
    np.testing.assert_array_equal(judge.memory["q_hold"][0], HOME)
    sample = arm_sample(2, q=HOME + 1e-3)
    judge.judge(sample)
    expected = -1e-3 * np.array(StopProfile().stiffness)
    np.testing.assert_allclose(sample["tau_applied"][0], np.maximum(expected, -(1.0 - 1e-4)), atol=1e-9)


@pytest.mark.parametrize("huge", [1e155, 1e300, 1.7e308, -1.7e308])
@pytest.mark.parametrize("opposed", [1.0, -1.0])
def test_a_stop_s_torque_is_a_number_whatever_finite_nonsense_the_state_says(huge, opposed):
    for joint in range(7):
        judge = SafetyJudge()
        judge.judge(arm_sample(0, tau_desired=0.5), Cause.COMMANDED)
        for t_ms in (1, 2, 3):
            sample = arm_sample(t_ms)
            sample["q"][0, joint], sample["dq"][0, joint] = huge, opposed * huge
            judge.judge(sample)
            assert np.isfinite(sample["tau_applied"]).all()
            assert np.abs(sample["tau_applied"]).max() <= t_ms
        sample = arm_sample(4)
        judge.judge(sample)
        assert np.abs(sample["tau_applied"]).max() <= 4.0


def test_masses_that_do_what_they_are_told_stop_in_about_the_ideal_distance():
    judge = SafetyJudge()
    inertia = np.array([1.2, 1.2, 0.8, 0.8, 0.1, 0.1, 0.08])
    q, dq = HOME.copy(), np.full(7, 0.6)
    for t_ms in range(1200):
        sample = arm_sample(t_ms, q=q, dq=dq)
        judge.judge(sample, Cause.COMMANDED if t_ms == 0 else Cause.NONE)
        for _ in range(10):
            dq = dq + sample["tau_applied"][0] / inertia * 1e-4
            q = q + dq * 1e-4
    assert judge.reason is Cause.COMMANDED
    assert np.abs(dq).max() < 1e-3
    ideal = 0.36 / (2.0 * BRAKING)
    assert np.all(q - HOME > 0.5 * ideal)
    assert np.all(q - HOME < 2.5 * ideal)


def test_the_torque_of_a_stop_goes_on_from_its_own_last_one():
    judge, sample = SafetyJudge(), arm_sample()
    torques = []
    for tick in range(6):
        sample["t_ns"] = (tick + 1) * 1_000_000
        sample["dq"][0, 0] = 2.0 if tick else 0.0  # pushed: it wants to damp with far more than a tick's step
        judge.judge(sample, Cause.COMMANDED)
        torques.append(float(sample["tau_applied"][0, 0]))
    assert torques == pytest.approx([-(1.0 - 1e-4) * tick for tick in range(6)])
