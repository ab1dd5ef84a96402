"""The judge on recorded good trials, and its stop on the simulated plant with a box between the pads."""

import numpy as np
import pytest

from hal.state import ARM_STATE
from rtstack.model.cell_description import CellDescription
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.safety.judge import Judgement
from rtstack.safety.limits import HARDWARE, NAMES, SafetyLimits
from rtstack.samples import ARM_SAMPLE
from sim_robot.cell import simulated_cell
from tests.support.plant_object import object_pose
from tests.support.safety.reachable_limits import LIMITS, cases
from tests.support.safety.recorded_trial import Recorded, empty_places, judges_of, read_recorded, replay

TRIALS = [(Controller.PROPOSED, 0.0), (Controller.NO_INTERIM, 30.0)]
HELD_TICK = 2500  # the box is up


@pytest.fixture(scope="module")
def recorded(runner, tmp_path_factory) -> list[Recorded]:
    """Two good trials; the study `good_trials` takes 140, and the demonstrations."""
    folder = tmp_path_factory.mktemp("good")
    found = []
    for seed, (controller, displacement_mm) in enumerate(TRIALS):
        path = folder / f"{seed}.mcap"
        assert runner.run(controller, displacement_mm, seed, path).safety_interventions == 0
        found.append(read_recorded(path))
    return found


@pytest.fixture(scope="module")
def stock(cell: CellDescription) -> SafetyLimits:
    """The limits of the cell."""
    return HARDWARE.tightened(cell.safety)


@pytest.mark.long
def test_no_intervention_in_a_good_trial_and_with_each_limit_in_reach_one_in_every_trial(recorded, cell, stock):
    judges = judges_of(cell)
    for trial in recorded:
        places = empty_places(trial)
        assert replay(trial, judges(stock), places) is None
        reached = {}
        for case in cases(trial, places, stock):
            seen = case.seen(judges)
            assert case.reached_by(seen), (case.limit, case.detail, seen)
            assert not case.reached_by(None)
            reached[case.limit] = reached.get(case.limit, 0) + 1
        assert set(reached) == set(LIMITS)


def test_every_limit_that_there_is_is_brought_into_reach():
    assert {name.partition(",")[0] for name in LIMITS} == {*NAMES, "clock", "finite values"}


@pytest.mark.parametrize("cause", ["not finite", "external torque", "other arm"])
def test_a_stop_keeps_hold_of_the_box_without_throwing_it(recorded, cell, stock, cause):
    """The plant is led to the same state by the recorded torques, bit by bit; then the judge stops and holds."""
    trial, pair = recorded[0], judges_of(cell)(stock)
    plant = simulated_cell("rice_box", TRIALS[0][1], 0)
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
            assert verdict is Judgement.PASS or k >= HELD_TICK
            arm.write(samples[side]["tau_applied"][0])
        if k >= HELD_TICK:
            heights.append(object_pose(plant.plant)[0][2])
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
