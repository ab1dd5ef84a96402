"""Two judges that watch each other, the age of their states, and the way out of a stop."""

from dataclasses import replace
from math import nextafter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.robots import FR3
from rtstack.safety.geometry import arm_distance, segment_distance
from rtstack.safety.judge import Base, Cause, Judgement, SafetyJudge, Tool, judges_of
from rtstack.safety.limits import HARDWARE
from rtstack.safety.records import StopProfile
from tests.support.safety.judge_oracle import distance, nearest
from tests.support.safety.judge_samples import HOME, arm_sample

# run as plain Python, numpy warns about inf - inf; compiled code does not
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")

LEFT, RIGHT = Base((-0.4, 0.5, 0.0)), Base((-0.4, -0.5, 0.0), (0.9, 0.1, 0.2, -0.1))


def _pair(limits=HARDWARE, right: Base = RIGHT) -> tuple[SafetyJudge, SafetyJudge]:
    return judges_of((limits, limits), (LEFT, right), (Tool(), Tool()))


def _both(judges, t_ms: int, **fields) -> tuple[Judgement, Judgement]:
    left, right = (judge.judge(arm_sample(t_ms, **fields)) for judge in judges)
    return left, right


@given(values=st.lists(st.one_of(st.sampled_from([-1.0, 0.0, 1.0, 0.5]), st.floats(-1, 1)), min_size=12, max_size=12))
@settings(derandomize=True)
def test_the_distance_of_two_segments(values):
    a, u, c, v = np.array(values).reshape(4, 3)
    u, v = (w if np.linalg.norm(w) > 0.05 else np.array([0.0, 0.3, 0.0]) for w in (u, v))
    assert segment_distance(a, a + u, c, c + v) == pytest.approx(nearest(a, a + u, c, c + v), abs=1e-6)


def test_the_distance_of_segments_in_each_of_its_cases():
    """Crossing, beside each end, along one line, parallel, antiparallel: each by hand."""
    x = np.eye(3)[0]
    cases = [
        ((-x, x), ([0, -1, 0.5], [0, 1, 0.5]), 0.5), ((-x, x), ([0, 1, 0], [0, 3, 0]), 1.0),
        ((-x, x), ([0, -3, 0], [0, -2, 0]), 2.0), ((-x, x), ([3, 4, 0], [3, 8, 0]), np.hypot(2, 4)),
        ((-x, x), ([-3, -8, 0], [-3, -4, 0]), np.hypot(2, 4)), ((-x, x), ([2, 0, 0], [5, 0, 0]), 1.0),
        ((-x, x), ([-5, 0, 0], [-2, 0, 0]), 1.0), ((-x, x), ([-5, 0, 1], [5, 0, 1]), 1.0),
        ((-x, x), ([5, 0, 1], [-5, 0, 1]), 1.0), ((-x, x), ([0.5, 0, 2], [0.6, 0, 2]), 2.0),
        ((-x, x), ([-0.6, 0, 2], [-0.5, 0, 2]), 2.0), (([0, 0, 0], [4, 0, 0]), ([3, -2, 1], [3, 6, 1]), 1.0),
        (([0, 0, 0], [2, 2, 0]), ([2, 0, 1], [0, 2, 1]), 1.0), (([0, 0, 0], [8, 0, 0]), ([6, 1, 0], [7, 3, 0]), 1.0),
    ]  # fmt: skip
    for (a, b), (c, d), expected in cases:
        ends = [np.array(p, dtype=float) for p in (a, b, c, d)]
        for p, q, r, s in ((0, 1, 2, 3), (1, 0, 2, 3), (0, 1, 3, 2), (2, 3, 0, 1), (3, 2, 1, 0)):
            assert segment_distance(ends[p], ends[q], ends[r], ends[s]) == pytest.approx(expected, abs=1e-12)


def test_segments_that_are_nearly_parallel_and_cross_touch():
    """Where a solution for parallel ones would be off by the angle."""
    for length in (0.02, 0.05, 0.5, 5.0):
        for angle in (3e-5, 1e-4, 1e-3):
            u = length / 2 * np.array([1.0, 0.0, 0.0])
            v = 0.7 * length / 2 * np.array([np.cos(angle), np.sin(angle), 0.0])
            assert segment_distance(-u, u, -v, v) < 1e-3 * length * angle
            assert segment_distance(v, -v, -u, u) < 1e-3 * length * angle


def test_the_arms_distance_is_that_of_their_capsules():
    rng = np.random.default_rng(2)
    for _ in range(12):
        right = Base((rng.uniform(-0.5, 0.9), rng.uniform(-0.9, 0.9), rng.uniform(-0.3, 0.3)), (0.3, 0.1, 0.2, 0.9))
        q = rng.uniform(FR3.limits.q_lower + 0.3, FR3.limits.q_upper - 0.3, (2, 7))
        judges = _pair(replace(HARDWARE, ee_speed_max=9.0), right)
        for judge, angles in zip(judges, q, strict=True):
            judge.judge(arm_sample(q=angles))
        left, other = judges[0].memory[0], judges[1].memory[0]
        expected = distance(q[0], q[1], LEFT, right)
        assert arm_distance(left, other, judges[0]._rules[0], 5.0) == pytest.approx(expected, abs=1e-9)
        # what is further away than asked for does not matter
        assert arm_distance(left, other, judges[0]._rules[0], expected - 0.01) == expected - 0.01


def test_each_judge_knows_the_body_of_the_other_arm():
    pads = (Tool(), Tool((0.2, 0.3, 0.1), 0.2))
    left, right = (judge._rules[0] for judge in judges_of((HARDWARE, HARDWARE), (LEFT, RIGHT), pads))
    assert not np.array_equal(left["radius"], right["radius"])
    for one, other in ((left, right), (right, left)):
        for field in ("radius", "reach"):
            np.testing.assert_array_equal(one[f"other_{field}"], other[field])


def test_one_arm_has_a_judge_alone_and_two_want_a_base_and_a_pad_each():
    (alone,) = judges_of((HARDWARE,), (LEFT,), (Tool(),))
    for _ in range(3):  # no other arm's silence matters
        assert alone.judge(arm_sample(5)) is Judgement.PASS
    with pytest.raises(ValueError, match="shorter"):
        judges_of((HARDWARE, HARDWARE), (LEFT, RIGHT), (Tool(),))


def test_arms_that_are_too_close_stop_both_of_them():
    judges = _pair()
    assert _both(judges, 0) == (Judgement.PASS, Judgement.PASS)
    apart = arm_distance(judges[0].memory[0], judges[1].memory[0], judges[0]._rules[0], 9.0)
    for bound, wrong in ((apart, False), (nextafter(apart, 0.0), False), (nextafter(apart, 9.0), True)):
        judges = _pair(replace(HARDWARE, arm_distance_min=bound))
        judges[0].judge(arm_sample(0))  # the other one was never seen: nothing to be close to
        assert not judges[0].stopping
        judges[1].judge(arm_sample(0))
        assert judges[1].stopping == wrong
        if wrong:
            assert judges[1].reason is Cause.ARM_DISTANCE
            assert judges[1].memory["value"][0] == pytest.approx(apart, abs=1e-12)
            judges[0].judge(arm_sample(1))
            assert judges[0].reason is Cause.ARM_DISTANCE


def test_where_one_arm_stops_the_other_one_does_in_its_next_tick():
    judges = _pair()
    _both(judges, 0)
    judges[1].judge(arm_sample(1, tau_desired=np.nan))
    assert not judges[0].stopping
    assert judges[0].judge(arm_sample(2)) is Judgement.STOPPING
    assert judges[0].reason is Cause.OTHER_ARM
    assert (judges[0].interventions, judges[1].interventions) == (0, 1)
    assert judges[0].explanation == Cause.OTHER_ARM.text
    # what somebody asks for, and what is wrong with the arm itself, come first
    for dq, reason in ((0.0, Cause.COMMANDED), (9.0, Cause.JOINT_POSITION)):
        judges = _pair()
        judges[1].judge(arm_sample(1, tau_desired=np.nan))
        judges[0].judge(arm_sample(1, dq=dq), Cause.COMMANDED)
        assert judges[0].reason is reason


MS = 1_000_000


def test_states_may_be_missing_for_twenty_milliseconds_and_no_longer():
    for extra_ns, stops in ((-1, False), (0, False), (1, True)):
        judge = SafetyJudge()
        for t_ms in (0, 7000):  # the first step of the clock may be a long one
            assert judge.judge(arm_sample(t_ms)) is Judgement.PASS
        sample = arm_sample(7020)
        sample["t_ns"] += extra_ns
        judge.judge(sample)
        assert judge.stopping == stops
        if stops:
            assert (judge.reason, judge.joint) == (Cause.STATE_GAP, 0)
            assert judge.memory["value"][0] == pytest.approx(0.020000001)
            assert judge.memory["bound"][0] == pytest.approx(0.02)


def test_a_robot_that_waits_may_show_its_first_state_for_ever():
    judge = SafetyJudge()
    for _ in range(60):
        assert judge.judge(arm_sample(5)) is Judgement.PASS
    assert judge.judge(arm_sample(6)) is Judgement.PASS


@pytest.mark.parametrize("changes", ["q", "dq", "tau_J"])
def test_any_measured_value_that_moves_keeps_a_state_alive(changes):
    judge = SafetyJudge()
    for t_ms in range(100):
        sample = arm_sample(t_ms)
        sample["tau_J"] = 0.0
        sample[changes][0, 3] += 1e-9 * t_ms
        assert judge.judge(sample) is Judgement.PASS


@pytest.mark.parametrize("clock_runs", [True, False])
def test_a_state_that_repeats_stops_after_twenty_milliseconds(clock_runs):
    judge = SafetyJudge()
    judge.judge(arm_sample(0))
    judge.judge(arm_sample(1))
    for k in range(1, 22):
        sample = arm_sample(1)
        if clock_runs:
            sample["t_ns"] = (1 + k) * MS
        judge.judge(sample)
        assert judge.stopping == (k == 21)
    assert (judge.reason, judge.joint) == (Cause.STATE_AGE, 0)
    assert judge.memory["value"][0] == pytest.approx(0.021)
    assert judge.memory["bound"][0] == pytest.approx(0.02)


def test_values_that_move_under_a_clock_that_stands_are_stale_too_and_a_new_state_ends_it():
    judge = SafetyJudge()
    judge.judge(arm_sample(0))
    judge.judge(arm_sample(1))
    for k in range(20):
        assert judge.judge(arm_sample(1, tau_J=1e-6 * k)) is Judgement.PASS
    judge.judge(arm_sample(2))
    assert judge.memory["stale_ns"][0] == 0
    for k in range(21):
        judge.judge(arm_sample(2, tau_J=1e-6 * k))
    assert judge.reason is Cause.STATE_AGE
    # a repeated state that skips time counts with all of it
    judge = SafetyJudge()
    for t_ms in (0, 1):
        judge.judge(arm_sample(t_ms))
    for t_ms in (15, 22):
        sample = arm_sample(1)
        sample["t_ns"] = t_ms * MS
        judge.judge(sample)
        assert judge.stopping == (t_ms == 22)
    assert judge.reason is Cause.STATE_AGE


@pytest.mark.parametrize("seen", [1, 2])
def test_time_never_runs_backwards(seen):
    judge = SafetyJudge()
    for t_ms in range(10, 10 + seen):
        judge.judge(arm_sample(t_ms))
    sample = arm_sample(9 + seen)
    sample["t_ns"] -= 1
    assert judge.judge(sample) is Judgement.STOPPING
    assert (judge.reason, judge.joint) == (Cause.TIME_BACKWARDS, 0)
    assert judge.memory["value"][0] == pytest.approx(-1e-9)
    assert judge.memory["bound"][0] == 0.0


def test_a_nanosecond_is_time_that_passes():
    judge = SafetyJudge()
    for t_ns in range(60):  # each state is a new one
        sample = arm_sample(t_ns)
        sample["t_ns"] = t_ns
        assert judge.judge(sample) is Judgement.PASS
    judge = SafetyJudge()
    for t_ns in (0, 1, 20 * MS + 2):  # the clock has moved: the gap counts
        sample = arm_sample(t_ns)
        sample["t_ns"] = t_ns
        judge.judge(sample)
    assert judge.reason is Cause.STATE_GAP


def test_what_is_wrong_with_the_state_is_told_before_its_age():
    judge = SafetyJudge()
    for t_ms in (0, 1):
        judge.judge(arm_sample(t_ms))
    judge.judge(arm_sample(90, tau_desired=np.nan))
    assert judge.reason is Cause.NOT_FINITE


@pytest.mark.parametrize("begun", [True, False])
def test_an_arm_does_not_go_on_alone_for_more_than_twenty_milliseconds(begun):
    judges = _pair()
    for t_ms in (0, 1, 2):
        judges[0].judge(arm_sample(t_ms))
        if begun:
            judges[1].judge(arm_sample(t_ms))
    silent = 0 if begun else 1
    for k in range(3, 40):
        judges[0].judge(arm_sample(k))
        if judges[0].stopping:
            break
        silent += 1
    assert silent == 20
    assert (judges[0].reason, judges[0].joint) == (Cause.PAIR_SKEW, 0)
    assert judges[0].memory["value"][0] == pytest.approx(0.021)
    assert judges[0].memory["bound"][0] == pytest.approx(0.02)


def test_a_state_that_repeats_does_not_pass_for_a_new_one_to_the_other_arm():
    judges = _pair(replace(HARDWARE, pair_skew_max_s=0.01))
    for t_ms in range(3):
        _both(judges, t_ms)
    for t_ms in range(3, 30):
        judges[0].judge(arm_sample(t_ms))
        judges[1].judge(arm_sample(2))
        if judges[0].stopping:
            break
    assert judges[0].reason is Cause.PAIR_SKEW
    assert judges[0].memory["value"][0] == pytest.approx(0.011)


def test_arms_with_clocks_of_their_own_are_no_skew():
    judges = _pair()
    for k in range(60):
        judges[0].judge(arm_sample(k))
        judges[1].judge(arm_sample(5000 + 3 * k))
    assert not judges[0].stopping
    assert not judges[1].stopping


def test_a_stop_lasts_and_its_evidence_with_it():
    judge = SafetyJudge()
    judge.judge(arm_sample(0))
    bad = arm_sample(1, tau_J=np.array([0, 0, 88.5, 0, 0, 0, 0]))
    judge.judge(bad)
    said = judge.explanation
    assert said == "joint 3: the measured torque is beyond the joint's range (88.5 Nm, allowed 87)"
    for t_ms in range(2, 40):
        assert judge.judge(arm_sample(t_ms, q=HOME + 0.5, dq=9.0 * (t_ms % 2))) is Judgement.STOPPING
    assert (judge.reason, judge.joint, judge.explanation) == (Cause.MEASURED_TORQUE, 3, said)
    assert judge.interventions == 1


def test_a_commanded_stop_is_no_intervention_but_an_unsolved_qp_is():
    for demand, count in ((Cause.COMMANDED, 0), (Cause.CONTROLLER, 1)):
        judge = SafetyJudge()
        assert judge.judge(arm_sample(), demand) is Judgement.STOPPING
        assert (judge.reason, judge.interventions) == (demand, count)


def test_a_stop_is_recovered_from_when_its_cause_is_gone_and_not_before():
    judges = _pair()
    _both(judges, 0)
    bad = arm_sample(1, tau_ext_hat_filtered=110.0)
    judges[0].judge(bad)
    judges[1].judge(arm_sample(1))
    assert judges[0].recover(bad) is Cause.EXTERNAL_TORQUE
    assert judges[0].recover(arm_sample(2), residual=np.full(7, 99.0)) is Cause.RESIDUAL
    assert judges[0].stopping
    assert judges[0].memory["q_hold"][0, 3] == HOME[3]
    # a long pause, and a clock that began anew, are no cause
    assert [j.recover(arm_sample(0)) for j in judges] == [Cause.NONE, Cause.NONE]
    assert not any(judge.stopping for judge in judges)
    assert judges[0].memory["tau_applied"][0].tolist() == [0.0] * 7
    assert _both(judges, 90_000) == (Judgement.PASS, Judgement.PASS)
    assert _both(judges, 99_000) == (Judgement.PASS, Judgement.PASS)


def test_a_recovery_is_of_one_arm_and_one_that_is_refused_changes_nothing():
    for side in (0, 1):
        judges = _pair()
        for t_ms in range(3):
            _both(judges, t_ms)
        bad = arm_sample(3, tau_ext_hat_filtered=110.0)
        judges[side].judge(bad)
        judges[1 - side].judge(arm_sample(4))
        mine, others = judges[side].memory.copy(), judges[1 - side].memory.copy()
        assert judges[side].recover(bad) is Cause.EXTERNAL_TORQUE
        assert judges[side].memory.tobytes() == mine.tobytes()
        assert judges[side].recover(arm_sample(5)) is Cause.NONE
        others["silent_ns"] = 0  # it is waited for anew
        assert judges[1 - side].memory.tobytes() == others.tobytes()
        # one arm does not go on while the other one is stopped
        assert judges[side].judge(arm_sample(6)) is Judgement.STOPPING
        assert judges[side].reason is Cause.OTHER_ARM


def test_what_is_wrong_with_the_whole_arm_is_said_without_a_joint():
    judge = SafetyJudge(replace(HARDWARE, power_max=1.0))
    judge.judge(arm_sample(0, dq=0.5, tau_J=np.array([2, 2, 0, 0, 0, 0, 0])))
    assert judge.explanation == "the mechanical power is too large (2 W, allowed 1)"


def test_a_judge_has_the_base_the_tool_and_the_profile_that_it_was_given():
    base, tool, profile = Base((1.0, 2.0, 3.0)), Tool((0.2, 0.3, 0.4), 0.5), StopProfile(reaction_s=0.004)
    rule = SafetyJudge(HARDWARE, base, tool, profile)._rules[0]
    assert rule["base_position"].tolist() == [1.0, 2.0, 3.0]
    assert rule["face"].tolist() == pytest.approx([0.0, 0.0, 0.607])
    assert rule["reaction"] == 0.004
    for judge, x in zip(
        judges_of((HARDWARE, HARDWARE), (base, Base()), (tool, tool), profile), (1.0, 0.0), strict=True
    ):
        rule = judge._rules[0]
        assert (rule["base_position"][0], rule["face"][2], rule["reaction"]) == (x, pytest.approx(0.607), 0.004)
    rule = SafetyJudge()._rules[0]
    assert (rule["face"][2], rule["reaction"]) == (pytest.approx(0.137), 0.002)


def test_every_reason_says_what_is_wrong_in_one_line():
    texts = [reason.text for reason in Cause]
    assert len(set(texts)) == len(texts)
    assert all(text and "\n" not in text for text in texts)
    assert [int(reason) for reason in Cause] == list(range(len(Cause)))
    assert Cause(14) is Cause.ARM_DISTANCE
    assert Cause.ARM_DISTANCE.unit == "m"
