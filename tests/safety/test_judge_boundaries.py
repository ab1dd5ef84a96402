"""Every line of the judge, drawn at its boundary first: exactly there, one step of a double around it, and nonsense."""

from dataclasses import replace
from math import inf, nan, nextafter

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hal.limits import CONTROL_PERIOD_S
from hal.robots import FR3
from rtstack.safety.judge import Base, Cause, Judgement, SafetyJudge
from rtstack.safety.judge import judge as compiled
from rtstack.safety.limits import HARDWARE
from tests.support.safety.judge_oracle import (
    BRAKING,
    REACTION_S,
    arm_reason,
    face,
    face_velocity,
    joint_reason,
    limited,
)
from tests.support.safety.judge_samples import HOME, arm_sample

# run as plain Python, numpy warns about inf - inf; compiled code does not
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")

NONE = np.zeros(7)
TURNED = Base((-0.4, 0.5, 0.1), (0.8, 0.1, -0.3, 0.5))


def _around(bound: float) -> tuple[float, float, float]:
    """Return the doubles just inside, at and just outside a positive or negative bound."""
    return nextafter(bound, 0.0), bound, nextafter(bound, inf if bound > 0 else -inf)


def _reason(sample, residual=NONE, limits=HARDWARE, base: Base | None = None) -> tuple[Cause, int]:
    judge = SafetyJudge(limits, base)
    verdict = judge.judge(sample, residual=residual)
    assert (verdict is Judgement.STOPPING) == judge.stopping
    return judge.reason, judge.joint if judge.stopping else 0


@pytest.mark.parametrize("joint", range(7))
def test_each_joint_line_is_exactly_where_its_definition_says(joint):
    lines = {
        "tau_J": HARDWARE.tau_J_max[joint],
        "tau_ext_hat_filtered": HARDWARE.tau_ext_max[joint],
        "residual": HARDWARE.tau_ext_max[joint],
        "dq": HARDWARE.dq_max[joint],
    }
    reasons = dict(
        zip(lines, (Cause.MEASURED_TORQUE, Cause.EXTERNAL_TORQUE, Cause.RESIDUAL, Cause.JOINT_VELOCITY), strict=True)
    )
    for name, line in lines.items():
        for sign in (1.0, -1.0):
            for value, wrong in zip(_around(sign * line), (False, False, True), strict=True):
                sample, residual = arm_sample(q=(FR3.limits.q_lower + FR3.limits.q_upper) / 2), np.zeros(7)
                (residual if name == "residual" else sample[name][0])[joint] = value
                expected = (reasons[name], joint + 1) if wrong else (Cause.NONE, 0)
                assert _reason(sample, residual, replace(HARDWARE, ee_speed_max=99.0)) == expected


@pytest.mark.parametrize("joint", range(7))
def test_the_position_line_moves_inwards_with_the_braking_distance(joint):
    for lines, sign in ((HARDWARE.q_upper, 1.0), (HARDWARE.q_lower, -1.0)):
        line = lines[joint]
        sample = arm_sample()
        sample["q"][0, joint] = line
        assert _reason(sample) == (Cause.NONE, 0)
        sample["q"][0, joint] = nextafter(line, sign * 99)
        assert _reason(sample) == (Cause.JOINT_POSITION, joint + 1)
        # beyond the line even a joint that comes back is stopped
        sample["dq"][0, joint] = -sign * 0.5
        assert _reason(sample) == (Cause.JOINT_POSITION, joint + 1)
        # inside, away from the line: nothing
        sample["q"][0, joint] = nextafter(line, 0.0 if abs(line) > 0.0 else 1.0) - sign * 0.01
        assert _reason(sample) == (Cause.NONE, 0)
        dq = sign * 2.0
        travel = dq * REACTION_S + dq * abs(dq) / (2.0 * BRAKING[joint])
        for nudge, reason in ((1e-9, Cause.JOINT_POSITION), (-1e-9, Cause.JOINT_VELOCITY)):
            sample["q"][0, joint], sample["dq"][0, joint] = line - travel + sign * nudge, dq
            assert _reason(sample) == (reason, joint + 1)


@pytest.mark.parametrize("joint", range(7))
def test_the_velocity_line_depends_on_the_position(joint):
    for room in (0.02, 0.1, 0.3):
        for sign in (1.0, -1.0):
            sample = arm_sample()
            q = HARDWARE.q_upper[joint] - room if sign > 0 else HARDWARE.q_lower[joint] + room
            room_there = HARDWARE.q_upper[joint] - q if sign > 0 else q - HARDWARE.q_lower[joint]
            allowed = np.sqrt(2.0 * FR3.limits.deceleration[joint] * room_there) - FR3.limits.velocity_offset[joint]
            allowed = min(HARDWARE.dq_max[joint], max(0.0, allowed))
            sample["q"][0, joint] = q
            for factor, wrong in ((1.0, False), (1.0 + 1e-12, True)):
                sample["dq"][0, joint] = sign * allowed * factor + (sign * 1e-12 if allowed == 0.0 and wrong else 0.0)
                assert _reason(sample) == ((Cause.JOINT_VELOCITY, joint + 1) if wrong else (Cause.NONE, 0))


NAMES = ["q", "dq", "tau_J", "tau_ext_hat_filtered", "tau_desired", "O_F_ext_hat_K", "O_T_EE", "residual"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_a_value_that_is_not_finite_stops_wherever_it_is(name, bad):
    size = {"O_F_ext_hat_K": 6, "O_T_EE": 16}.get(name, 7)
    for index in range(size):
        sample, residual = arm_sample(), np.zeros(7)
        (residual if name == "residual" else sample[name].reshape(-1))[index] = bad
        judge = SafetyJudge()
        assert judge.judge(sample, residual=residual) is Judgement.STOPPING
        assert (judge.reason, judge.joint) == (Cause.NOT_FINITE, index + 1 if size == 7 else 0)
        assert np.isfinite(sample["tau_applied"]).all()
        assert "not finite" in judge.explanation


def test_face_and_velocity_are_those_of_the_published_kinematics():
    rng = np.random.default_rng(1)
    judge = SafetyJudge(base=TURNED)
    for t_ms in range(5):
        q, dq = rng.uniform(FR3.limits.q_lower + 0.5, FR3.limits.q_upper - 0.5), rng.normal(size=7) * 0.3
        judge.judge(arm_sample(t_ms, q=q, dq=dq))
        np.testing.assert_allclose(judge.memory["face_world"][0], face(q, TURNED), atol=1e-12)
        np.testing.assert_allclose(judge.memory["face_velocity"][0], face_velocity(q, dq, TURNED), atol=1e-8)


@pytest.mark.parametrize("axis", range(3))
def test_the_box_of_the_end_effector_is_closed(axis):
    judge = SafetyJudge(base=TURNED)
    judge.judge(arm_sample(q=HOME + 0.3))
    place = float(judge.memory["face_world"][0, axis])
    for name, inside, outside in (("ee_lower", -inf, inf), ("ee_upper", inf, -inf)):
        for line, wrong in ((place, False), (nextafter(place, outside), True), (nextafter(place, inside), False)):
            corner = list(getattr(HARDWARE, name))
            corner[axis] = line
            limits = replace(HARDWARE, **{name: tuple(corner)})
            expected = (Cause.WORKSPACE, 0) if wrong else (Cause.NONE, 0)
            assert _reason(arm_sample(q=HOME + 0.3), limits=limits, base=TURNED) == expected


def test_the_speed_of_the_end_effector_and_the_power_have_their_lines():
    dq, tau = np.array([0.5, 0.4, -0.3, 0.2, 0.1, -0.6, 0.7]), np.array([20.0, -30.0, 9.0, 8.0, 1.0, 2.0, -3.0])
    judge = SafetyJudge()
    judge.judge(arm_sample(dq=dq))
    v = judge.memory["face_velocity"][0]
    speed = float(np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]))
    power = 0.0
    for a, b in zip(tau, dq, strict=True):
        power += float(a * b)
    for name, line, reason in (("ee_speed_max", speed, Cause.SPEED), ("power_max", abs(power), Cause.POWER)):
        for sign in (1.0, -1.0):
            for bound, wrong in ((line, False), (nextafter(line, 0.0), True), (nextafter(line, inf), False)):
                expected = (reason, 0) if wrong else (Cause.NONE, 0)
                sample = arm_sample(dq=dq, tau_J=sign * tau)
                assert _reason(sample, limits=replace(HARDWARE, **{name: bound})) == expected


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_torque_and_torque_rate_are_limited_exactly(joint, sign):
    step = 1.0 * (1.0 - 1e-4)
    for start in (0.0, HARDWARE.tau_max[joint] - 0.5, HARDWARE.tau_max[joint]):
        for wanted in (start, start + step, nextafter(start + step, 99.0), start - step, start - 2.0, 1e6, -1e6):
            last = np.zeros(7)
            last[joint] = sign * start
            judge = SafetyJudge()
            judge.memory["tau_applied"][0] = last
            desired = last.copy()
            desired[joint] = sign * wanted
            sample = arm_sample(tau_desired=desired)
            verdict = judge.judge(sample)
            expected = limited(desired, last, HARDWARE)
            assert sample["tau_applied"][0].tobytes() == expected.tobytes()
            assert (verdict is Judgement.LIMITED) == bool(np.any(expected != desired))
            if verdict is Judgement.LIMITED:
                assert judge.joint == joint + 1
                over = abs(wanted) > HARDWARE.tau_max[joint]
                assert judge.memory["bound"][0] == pytest.approx(HARDWARE.tau_max[joint] if over else step, abs=1e-12)
                assert judge.memory["value"][0] == (sign * wanted if over else sign * wanted - sign * start)


def test_the_compiled_judge_answers_with_the_codes_of_verdict_and_reason():
    for field, value, expected in (
        ("tau_desired", 0.5, (Judgement.PASS, Cause.NONE)),
        ("tau_desired", 2.0, (Judgement.LIMITED, Cause.TORQUE_RATE)),
        ("tau_desired", 88.0, (Judgement.LIMITED, Cause.TORQUE)),
        ("tau_J", -88.0, (Judgement.STOPPING, Cause.MEASURED_TORQUE)),
    ):
        judge = SafetyJudge()
        sample = arm_sample(**{field: np.array([0, 0, 0, value, 0, 0, 0])})
        assert compiled(sample, NONE, judge.memory, judge._other, judge._rules, 0) == expected


def test_a_limit_of_torque_is_told_before_one_of_its_rate():
    judge = SafetyJudge()
    sample = arm_sample()
    sample["tau_desired"][0, 1], sample["tau_desired"][0, 4] = 88.0, 2.0
    assert judge.judge(sample) is Judgement.LIMITED
    assert (judge.joint, judge.memory["value"][0]) == (2, 88.0)
    assert (judge.limited, judge.interventions) == (1, 1)


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_torque_s_bound_comes_first_where_the_robot_was_commanded_more(joint, sign):
    for told in (200.0, 1e9, 1.7e308):
        judge, sample = SafetyJudge(), arm_sample()
        judge.memory["tau_applied"][0, joint] = sign * told
        assert judge.judge(sample) is Judgement.LIMITED
        assert sample["tau_applied"][0, joint] == sign * (HARDWARE.tau_max[joint] - (1.0 - 1e-4))


@given(
    seed=st.integers(0, 2**31),
    values=st.lists(
        st.sampled_from([0.0, -0.0, 1e-300, 86.9, 87.0, 1e9, -1e9, inf, -inf, nan]), min_size=7, max_size=7
    ),
)
def test_whatever_is_wanted_the_answer_is_finite_limited_and_continuous(seed, values):
    rng = np.random.default_rng(seed)
    judge, last = SafetyJudge(), np.zeros(7)
    for k in range(20):
        wanted = values if k == 10 else 40.0 * rng.normal(size=7)
        sample = arm_sample(q=HOME + 0.1 * rng.normal(size=7), dq=rng.normal(size=7), tau_desired=wanted)
        judge.judge(sample)
        applied = sample["tau_applied"][0].copy()
        assert np.all(np.isfinite(applied))
        assert np.all(np.abs(applied) <= FR3.limits.tau_max)
        assert np.all(np.abs(applied - last) <= FR3.limits.tau_rate_max * CONTROL_PERIOD_S)
        last = applied


@pytest.mark.parametrize(("wanted", "reason"), [(200.0, Cause.TORQUE), (60.0, Cause.TORQUE_RATE)])
def test_who_wants_the_impossible_for_three_ticks_is_stopped(wanted, reason):
    judge, sample = SafetyJudge(), arm_sample()
    step, ticks = 1.0 - 1e-4, iter(range(1, 100))

    def ask(torque) -> Judgement:
        sample["tau_desired"][0, 2] = torque
        sample["t_ns"] = next(ticks) * 1_000_000
        sample["q"][0, 0] += 1e-9  # a state that lives
        return judge.judge(sample)

    assert [ask(wanted) for _ in range(2)] == [Judgement.LIMITED] * 2
    assert ask(sample["tau_applied"][0, 2]) is Judgement.PASS  # back to its senses: it counts anew
    assert [ask(wanted) for _ in range(2)] == [Judgement.LIMITED] * 2
    assert not judge.stopping
    last = float(sample["tau_applied"][0, 2])
    assert ask(wanted) is Judgement.STOPPING
    assert (judge.reason, judge.joint, judge.memory["value"][0] > 50.0) == (reason, 3, True)
    assert sample["tau_applied"][0, 2] == pytest.approx(last - step)  # no more of it
    assert ask(0.0) is Judgement.STOPPING
    assert (judge.limited, judge.interventions) == (4, 5)


@pytest.mark.parametrize("demand", [Cause.NONE, Cause.COMMANDED])
def test_the_judge_is_blind_from_when_a_state_is_stale_whoever_asked_for_the_stop(demand):
    judge, sample = SafetyJudge(), arm_sample()
    gap_ms = round(HARDWARE.state_gap_max_s * 1e3)
    blind = []
    for tick in range(gap_ms + 4):
        sample["t_ns"] = (tick + 1) * 1_000_000
        judge.judge(sample, demand)
        blind.append(judge.blind)
    assert blind == [False] * (gap_ms + 2) + [True] * 2  # the first two states are what its time is counted from
    sample["q"][0, 3] += 1e-9
    sample["t_ns"] += 1_000_000
    judge.judge(sample)
    assert judge.blind is False


def _evidence(sample, reason: Cause, joint: int, residual=NONE, limits=HARDWARE) -> tuple[float, float]:
    """Return what was found and what was allowed."""
    judge = SafetyJudge(limits)
    judge.judge(sample, residual=residual)
    assert (judge.reason, judge.joint) == (reason, joint)
    return float(judge.memory["value"][0]), float(judge.memory["bound"][0])


@pytest.mark.parametrize("joint", range(7))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_evidence_of_a_joint_is_what_was_found_and_what_was_allowed(joint, sign):
    line = (HARDWARE.q_upper if sign > 0 else HARDWARE.q_lower)[joint]
    middle = (FR3.limits.q_lower + FR3.limits.q_upper) / 2
    for place, dq in ((line - sign * 1e-3, sign * 2.0), (line + sign * 0.1, -sign * 0.5), (line + sign * 0.1, 0.0)):
        sample = arm_sample()
        sample["q"][0, joint], sample["dq"][0, joint] = place, dq
        travel = dq * REACTION_S + dq * abs(dq) / (2.0 * BRAKING[joint])
        found, allowed = _evidence(sample, Cause.JOINT_POSITION, joint + 1)
        assert found == pytest.approx(place + (travel if dq * sign > 0 else 0.0), abs=1e-12)
        assert allowed == line
    sample = arm_sample(q=middle)
    sample["dq"][0, joint] = sign * HARDWARE.dq_max[joint] * 1.001
    found = _evidence(sample, Cause.JOINT_VELOCITY, joint + 1)
    assert found == (sign * HARDWARE.dq_max[joint] * 1.001, HARDWARE.dq_max[joint])
    for name, reason, lines in (
        ("tau_J", Cause.MEASURED_TORQUE, HARDWARE.tau_J_max),
        ("tau_ext_hat_filtered", Cause.EXTERNAL_TORQUE, HARDWARE.tau_ext_max),
        ("residual", Cause.RESIDUAL, HARDWARE.tau_ext_max),
    ):
        sample, residual = arm_sample(), np.zeros(7)
        (residual if name == "residual" else sample[name][0])[joint] = sign * 200.0
        assert _evidence(sample, reason, joint + 1, residual) == (sign * 200.0, lines[joint])
    sample = arm_sample()
    sample["q"][0, joint] = sign * inf
    found, allowed = _evidence(sample, Cause.NOT_FINITE, joint + 1)
    assert np.isnan(found)
    assert allowed == 0.0


def test_the_evidence_of_the_whole_arm_is_what_was_found_and_what_was_allowed():
    dq, tau = np.array([0.5, 0.4, -0.3, 0.2, 0.1, -0.6, 0.7]), np.array([20.0, -30.0, 9.0, 8.0, 1.0, 2.0, -3.0])
    place, speed = face(HOME, Base()), np.linalg.norm(face_velocity(HOME, dq, Base()))
    for axis in range(3):
        for name, sign in (("ee_lower", 1.0), ("ee_upper", -1.0)):
            corner = [-9.0 * sign] * 3
            corner[axis] = place[axis] + 0.125 * sign
            limits = replace(HARDWARE, **{name: tuple(corner)})
            found, allowed = _evidence(arm_sample(), Cause.WORKSPACE, 0, limits=limits)
            assert found == pytest.approx(place[axis], abs=1e-12)
            assert allowed == corner[axis]
    for name, reason, value in (("ee_speed_max", Cause.SPEED, speed), ("power_max", Cause.POWER, tau @ dq)):
        for sign in (1.0, -1.0):
            sample, limits = arm_sample(dq=dq, tau_J=sign * tau), replace(HARDWARE, **{name: abs(value) / 2.0})
            found, allowed = _evidence(sample, reason, 0, limits=limits)
            assert found == pytest.approx(value if name == "ee_speed_max" else sign * value, abs=1e-8)
            assert allowed == abs(value) / 2.0
    sample = arm_sample()
    sample["O_F_ext_hat_K"][0, 3] = nan
    found, allowed = _evidence(sample, Cause.NOT_FINITE, 0)
    assert np.isnan(found)
    assert allowed == 0.0


_NASTY = st.sampled_from([0.0, -0.0, 5e-324, -5e-324, 1.0, -1.0, inf, -inf, nan])


@st.composite
def _joint_values(draw, lower, upper):
    """Values (7,): most of them inside, up to two at a boundary, around it, or nonsense."""
    lower, upper = np.array(lower), np.array(upper)
    values = lower + np.random.default_rng(draw(st.integers(0, 99))).uniform(0.2, 0.8, 7) * (upper - lower)
    for joint in draw(st.sets(st.integers(0, 6), max_size=2)):
        bounds = [*_around(lower[joint]), *_around(upper[joint])]
        values[joint] = draw(st.one_of(st.sampled_from(bounds), _NASTY))
    return values


@given(
    q=_joint_values(HARDWARE.q_lower, HARDWARE.q_upper),
    dq=_joint_values(-np.array(HARDWARE.dq_max), HARDWARE.dq_max),
    tau_J=_joint_values(-np.array(HARDWARE.tau_J_max), HARDWARE.tau_J_max),
    tau_ext=_joint_values(-np.array(HARDWARE.tau_ext_max), HARDWARE.tau_ext_max),
    desired=_joint_values(-np.array(HARDWARE.tau_max), HARDWARE.tau_max),
    residual=_joint_values(-np.array(HARDWARE.tau_ext_max), HARDWARE.tau_ext_max),
    slow=st.sampled_from([0.01, 0.1, 1.0]),
)
@settings(derandomize=True)
def test_the_judge_says_what_the_definitions_say(q, dq, tau_J, tau_ext, desired, residual, slow):
    limits = replace(HARDWARE, ee_upper=(0.5, 0.5, 0.9), ee_speed_max=0.8, power_max=60.0)
    sample = arm_sample(q=q, dq=slow * dq, tau_J=tau_J, tau_ext_hat_filtered=tau_ext, tau_desired=desired)
    expected = joint_reason(sample, residual, limits)
    if expected[0] is Cause.NONE:
        reason, margin = arm_reason(sample, TURNED, limits)
        assume(margin > 1e-6)
        expected = (reason, 0)
    assert _reason(sample, residual, limits, TURNED) == expected
    if expected[0] is Cause.NONE:
        np.testing.assert_array_equal(sample["tau_applied"][0], limited(desired, np.zeros(7), limits))
    assert np.isfinite(sample["tau_applied"]).all()
    assert np.all(np.abs(sample["tau_applied"][0]) <= 1.0)
