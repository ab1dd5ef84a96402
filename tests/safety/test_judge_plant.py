"""The judge on recorded good trials, and its stop on the simulated plant with a box between the pads."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from hal.state import ARM_STATE
from rtstack.log.reader import read_log
from rtstack.model.cell_description import CellDescription
from rtstack.safety.judge import Base, Reason, SafetyJudge, Tool, Verdict, pair_of_judges
from rtstack.safety.limits import HARDWARE, SafetyLimits
from rtstack.samples import ARM_SAMPLE, SIDES, Mode
from rtstack.trials.specification import Controller
from sim_robot.cell import simulated_cell

HELD_TICK = 2500  # the box is up


@dataclass(frozen=True, slots=True)
class Recorded:
    """The states, torques and residuals (2, n) of a trial, and from when on it was stopping."""

    arms: np.ndarray
    residuals: np.ndarray
    stopping: int
    seed: int


def _read(path: Path, seed: int) -> Recorded:
    log = read_log(path)
    topics = [log.topic(f"/{side}/arm") for side in SIDES]
    controls = [log.topic(f"/{side}/control") for side in SIDES]
    arms = np.zeros((2, min(map(len, topics))), ARM_SAMPLE)
    for side, topic in enumerate(topics):
        for name in ARM_SAMPLE.names or ():
            arms[name][side] = topic[name][: arms.shape[1]]
    residuals = np.array([c["momentum_residual"][: arms.shape[1]] for c in controls])
    return Recorded(arms, residuals, int(np.flatnonzero(controls[0]["mode"] == Mode.STOPPING)[0]), seed)


@pytest.fixture(scope="module")
def recorded(runner, tmp_path_factory) -> list[Recorded]:
    """Five good trials: controllers and displacements."""
    folder = tmp_path_factory.mktemp("good")
    trials = [(Controller.PROPOSED, 0.0), (Controller.PROPOSED, 30.0), *((c, -15.0) for c in list(Controller)[1:])]
    found = []
    for seed, (controller, displacement_mm) in enumerate(trials):
        path = folder / f"{seed}.mcap"
        assert runner.run(controller, displacement_mm, seed, path).safety_interventions == 0
        found.append(_read(path, seed))
    return found


@pytest.fixture(scope="module")
def judges(cell: CellDescription) -> Callable[..., tuple[SafetyJudge, SafetyJudge]]:
    """Makes the judges of the cell with these limits."""
    left, right = (Base(m.base_position, m.base_orientation_wxyz) for m in (cell.left, cell.right))
    tool = Tool(cell.pad.size, cell.pad.flange_to_face)
    return lambda limits=HARDWARE: pair_of_judges(limits, left, right, tool)


def _replay(trial: Recorded, pair: tuple[SafetyJudge, SafetyJudge], until: int | None = None) -> Reason:
    """Judge a trial tick by tick as its session did; return the reason of the first stop or limit."""
    for k in range(trial.stopping if until is None else until):
        for side, judge in enumerate(pair):
            verdict = judge.judge(trial.arms[side, k : k + 1], residual=trial.residuals[side, k])
            if verdict is not Verdict.PASS:
                return judge.reason if judge.stopping else Reason.TORQUE_RATE
    return Reason.NONE


def test_no_intervention_in_a_good_trial(recorded, judges):
    for trial in recorded:
        before = trial.arms["tau_applied"].copy()
        pair = judges()
        assert _replay(trial, pair) is Reason.NONE
        assert sum(judge.interventions for judge in pair) == 0
        np.testing.assert_array_equal(trial.arms["tau_applied"], before)


# each limit in reach of a grab, and what is then said. Torques are limited, not stopped
REACHABLE = {
    "q_lower": ([-2.7, 0.1, -2.9, -3.0, -2.8, 0.6, -3.0], Reason.JOINT_POSITION),
    "q_upper": ([2.7, 0.08, 2.9, -0.2, 2.8, 4.5, 3.0], Reason.JOINT_POSITION),
    "dq_max": ([0.1] * 7, Reason.JOINT_VELOCITY),
    "tau_max": ([0.5] * 7, Reason.TORQUE_RATE),
    "tau_J_max": ([40.0, 20.0, 20.0, 15.0, 8.0, 8.0, 8.0], Reason.MEASURED_TORQUE),
    "tau_ext_max": ([10.0] * 7, Reason.EXTERNAL_TORQUE),
    "tau_rate_max": (5.0, Reason.TORQUE_RATE),
    "ee_lower": ([-9.0, -0.3, 0.0], Reason.WORKSPACE),
    "ee_upper": ([9.0, 9.0, 0.4], Reason.WORKSPACE),
    "ee_speed_max": (0.2, Reason.SPEED),
    "power_max": (5.0, Reason.POWER),
    "arm_distance_min": (0.4, Reason.ARM_DISTANCE),
    "state_gap_max_s": (0.0009, Reason.STATE_GAP),
    "pair_skew_max_s": (0.0009, Reason.PAIR_SKEW),
}


@pytest.mark.parametrize("name", REACHABLE)
def test_with_each_limit_in_reach_every_trial_is_intervened_in(recorded, judges, name):
    value, reason = REACHABLE[name]
    limits = HARDWARE.tightened({name: value})
    expected = {reason, Reason.RESIDUAL} if reason is Reason.EXTERNAL_TORQUE else {reason}
    for trial in recorded:
        assert _replay(trial, judges(limits)) in expected


def test_every_limit_has_been_in_reach():
    assert set(REACHABLE) == set(SafetyLimits.__slots__)


@pytest.mark.parametrize("cause", ["not finite", "external torque", "other arm"])
def test_a_stop_keeps_hold_of_the_box_without_throwing_it(recorded, judges, cause):
    """The plant is led to the same state by the recorded torques, bit by bit; then the judge stops and holds."""
    trial, pair = recorded[0], judges()
    plant = simulated_cell("rice_box", 0.0, trial.seed)
    arms, samples = (plant.left, plant.right), np.zeros((2, 1), ARM_SAMPLE)
    heights, fastest = [], 0.0
    for k in range(HELD_TICK + 1500):
        for side, arm in enumerate(arms):
            samples[side].view(np.uint8)[: ARM_STATE.itemsize] = arm.read().record.view(np.uint8)
            if k < HELD_TICK:
                samples[side]["tau_desired"] = trial.arms["tau_desired"][side, k]
        if k == HELD_TICK:
            assert samples["q"][:, 0].tobytes() == trial.arms["q"][:, k].tobytes()
            if cause == "external torque":
                samples["tau_ext_hat_filtered"][0, 0, 2] = -110.0
            else:
                samples["tau_desired"][1 if cause == "other arm" else 0, 0, 3] = np.nan
        for side, arm in enumerate(arms):
            verdict = pair[side].judge(samples[side])
            assert verdict is Verdict.PASS or k >= HELD_TICK
            arm.write(samples[side]["tau_applied"][0])
        if k >= HELD_TICK:
            heights.append(plant.object_truth()[0][2])
            fastest = max(fastest, float(np.abs(samples["dq"]).max()))
    assert all(judge.stopping for judge in pair)
    assert pair[0].interventions + pair[1].interventions == 1
    assert np.abs(samples["dq"]).max() < 0.02
    assert fastest < 1.0
    # it swings on for the braking distance, is not thrown, and neither falls nor creeps
    assert max(heights) - heights[0] < 0.02
    assert min(heights) > heights[0] - 0.005
    assert abs(heights[-1] - heights[-500]) < 1e-3
    squeeze = samples["O_F_ext_hat_K"][:, 0, 1]
    assert abs(squeeze[0]) > 10.0
    assert squeeze[0] == pytest.approx(-squeeze[1], rel=0.3)
