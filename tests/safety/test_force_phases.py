"""How hard the pads may push by phase: the judge's rows, the robot's own thresholds behind them, a cell's say in it."""

from dataclasses import replace
from math import nextafter

import numpy as np
import pytest

from hal.limits import COLLISION_TORQUES, CollisionBehaviour
from rtstack.cells import default_cell_file
from rtstack.model.cell_description import load_cell_description
from rtstack.safety.judge import Cause, ForcePhase, Judgement, SafetyJudge
from rtstack.safety.limits import FORCES_BY_PHASE, HARDWARE, LimitWidened, SafetyLimits
from rtstack.samples import ARM_SAMPLE
from rtstack.trials.tightening import limits_of_arms

CELL = HARDWARE.tightened(FORCES_BY_PHASE)
ISO_SMALLEST_N = 65.0  # ISO/TS 15066:2016, Table A.2: the face, quasi-static


def judged(limits: SafetyLimits, phase: ForcePhase, field: str, index: int, value: float) -> SafetyJudge:
    """Return a judge that has seen one state in which this value is felt."""
    sample = np.zeros(1, ARM_SAMPLE)
    sample["q"] = 0.5 * (np.array(HARDWARE.q_lower) + HARDWARE.q_upper)
    sample["O_T_EE"] = np.eye(4)
    residual = np.zeros(7)
    (residual if field == "residual" else sample[field][0])[index] = value
    judge = SafetyJudge(limits)
    judge.expect(phase)
    judge.judge(sample, residual=residual)
    return judge


@pytest.mark.parametrize("phase", ForcePhase)
@pytest.mark.parametrize(
    ("field", "reason"), [("tau_ext_hat_filtered", Cause.EXTERNAL_TORQUE), ("residual", Cause.RESIDUAL)]
)
def test_each_joint_may_feel_its_phases_torque_and_not_the_next_number(phase, field, reason):
    for joint, bound in enumerate(CELL.tau_ext_by_phase[phase]):
        assert not judged(CELL, phase, field, joint, -bound).stopping
        stopped = judged(CELL, phase, field, joint, nextafter(bound, 1e3))
        assert (stopped.stopping, stopped.reason, stopped.joint) == (True, reason, joint + 1)


@pytest.mark.parametrize("phase", ForcePhase)
def test_a_pad_may_push_with_its_phases_force_and_not_the_next_number(phase):
    bound = float(CELL.force_by_phase[phase])
    assert not judged(CELL, phase, "O_F_ext_hat_K", 1, -bound).stopping
    assert not judged(CELL, phase, "O_F_ext_hat_K", 4, 2.0 * bound).stopping  # a moment is no force
    stopped = judged(CELL, phase, "O_F_ext_hat_K", 1, nextafter(bound, 1e3))
    assert (stopped.reason, stopped.joint) == (Cause.FORCE, 0)
    assert stopped.explanation == f"{Cause.FORCE.text} ({bound:.4g} N, allowed {bound:.4g})"


def test_a_phase_holds_from_the_tick_in_which_it_is_expected():
    sample, residual = np.zeros(1, ARM_SAMPLE), np.zeros(7)
    sample["q"] = 0.5 * (np.array(HARDWARE.q_lower) + HARDWARE.q_upper)
    sample["O_T_EE"] = np.eye(4)
    sample["O_F_ext_hat_K"][0, 0] = 100.0
    judge = SafetyJudge(CELL)
    for phase, verdict in (
        (ForcePhase.IMPACT, Judgement.PASS), (ForcePhase.CONTACT, Judgement.PASS),
        (ForcePhase.APPROACH, Judgement.STOPPING),
        (ForcePhase.IMPACT, Judgement.STOPPING),
    ):  # fmt: skip
        judge.expect(phase)
        sample["t_ns"] += 1_000_000
        sample["q"] += 1e-9
        assert judge.judge(sample, residual=residual) is verdict


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, -1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1), (-1, 0, 1), (1, 1, 1)])
def test_a_force_counts_by_its_size_in_any_direction(direction):
    force = CELL.force_by_phase[ForcePhase.IMPACT] * np.array(direction) / np.linalg.norm(direction)
    for share, reason in ((0.999, Cause.NONE), (1.001, Cause.FORCE)):
        sample, judge = np.zeros(1, ARM_SAMPLE), SafetyJudge(CELL)
        sample["q"] = 0.5 * (np.array(HARDWARE.q_lower) + HARDWARE.q_upper)
        sample["O_T_EE"] = np.eye(4)
        sample["O_F_ext_hat_K"][0] = [*share * force, 0.0, 0.0, 0.0]
        judge.expect(ForcePhase.IMPACT)
        judge.judge(sample)
        assert judge.reason is reason


def test_another_residual_is_judged_with_the_same_sample():
    sample, judge = np.zeros(1, ARM_SAMPLE), SafetyJudge(CELL)
    sample["q"] = 0.5 * (np.array(HARDWARE.q_lower) + HARDWARE.q_upper)
    sample["O_T_EE"] = np.eye(4)
    assert judge.judge(sample, residual=np.zeros(7)) is Judgement.PASS
    assert judge.judge(sample, residual=np.full(7, 1e3)) is Judgement.STOPPING
    assert judge.reason is Cause.RESIDUAL


def test_no_phase_is_wider_than_the_one_before():
    limits = CELL.tightened({"tau_ext_max": [8.0] * 7, "force_max": 30.0})
    assert np.all(np.diff(limits.tau_ext_by_phase, axis=0) <= 0.0)
    np.testing.assert_array_equal(limits.tau_ext_by_phase[ForcePhase.APPROACH], [8.0] * 7)
    np.testing.assert_array_equal(limits.force_by_phase, [30.0] * 3)


def test_the_robots_own_line_is_outside_the_judges_and_inside_what_a_face_may_feel():
    approach = CELL.collisions(ForcePhase.APPROACH)
    assert approach.collision_forces[0] == pytest.approx(ISO_SMALLEST_N)
    assert np.all(np.array(approach.collision_torques) > CELL.tau_ext_by_phase[ForcePhase.APPROACH])
    assert CELL.collisions(ForcePhase.IMPACT) == CollisionBehaviour()
    widest = CollisionBehaviour()
    for phase in ForcePhase:
        told = CELL.collisions(phase)
        for name in ("collision_torques", "collision_forces", "contact_torques", "contact_forces"):
            assert np.all(np.array(getattr(told, name)) <= getattr(widest, name)), (phase, name)
        assert np.all(np.array(told.contact_torques) <= told.collision_torques)


def test_a_cell_has_the_small_forces_unless_its_file_says_otherwise():
    cell = load_cell_description(default_cell_file())
    assert limits_of_arms(cell)[0].force_approach_max == FORCES_BY_PHASE["force_approach_max"]
    wide = replace(cell, safety=cell.safety | {"force_approach_max": 90.0, "tau_ext_approach_max": COLLISION_TORQUES})
    assert limits_of_arms(wide)[1].force_approach_max == 90.0
    with pytest.raises(LimitWidened, match=r"safety.force_approach_max = 300.0: may only tighten, .* at most 250"):
        HARDWARE.tightened({"force_approach_max": 300.0})


def test_the_forces_by_phase_are_those_of_their_sources():
    """libfranka's generate_joint_position_motion.cpp, and ISO/TS 15066:2016, Table A.2; joints 1 to 4 as measured."""
    assert FORCES_BY_PHASE["tau_ext_approach_max"] == (20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0)
    assert FORCES_BY_PHASE["tau_ext_contact_max"] == (60.0, 60.0, 60.0, 60.0, 30.0, 30.0, 30.0)
    assert FORCES_BY_PHASE["force_contact_max"] == 140.0
    assert FORCES_BY_PHASE["force_approach_max"] == 50.0
