"""Trials on robots whose estimate of the force is biased: detected all the same, refused where that is impossible."""

import re
from dataclasses import replace
from math import inf

import mujoco
import numpy as np
import pytest

from hal.cell import Cell
from rtstack.cells import load_description
from rtstack.control.parameters import DetectorParameters
from rtstack.model.arm_model import ArmModel
from rtstack.references.demonstration import end_effector_pose
from rtstack.trials.assembly import cell_parameters
from rtstack.trials.demonstration import PreparedDemonstration
from rtstack.trials.errors import TrialError
from rtstack.trials.estimate import check_estimate, resting_force
from rtstack.trials.move import PreparedMotion
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, SweepSpecification, TrialSpecification
from rtstack.trials.trial import prepare_trial, run_trial
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.faults.file import faults_in
from sim_robot.scene import NO_OBJECT
from tests.support.sampling import sampled

DIRECTIONS = {"up": (0.0, 0.0, 1.0), "outwards": (0.0, 1.0, 0.0), "inwards": (0.0, -1.0, 0.0)}


class Truth:
    """Sees each millisecond of a plant. first: the one in which a pad first touches; largest: force on a pad, N."""

    def __init__(self, cell: SimulatedCell) -> None:
        plant = cell.plant
        self._model, self._data, self._advance = plant.model, plant.data, cell.next_state
        # 1: a geom of the object, 2 and 4: of the pads; a contact has the sum of both
        bodies = (plant._object_body, *plant.pad_bodies)
        self._kind = sum(2**k * (plant.model.geom_bodyid == body) for k, body in enumerate(bodies))
        self._wrench = np.zeros(6)
        self.tick, self.first, self.largest = 0, -1, 0.0
        cell.next_state = self._look  # type: ignore[method-assign]

    def _look(self) -> None:
        self._advance()
        kinds = self._kind[self._data.contact.geom].sum(axis=1)
        for pad in (3, 5):
            push = 0.0
            for index in np.flatnonzero(kinds == pad):
                self.first = self.tick if self.first < 0 else self.first
                mujoco.mj_contactForce(self._model, self._data, int(index), self._wrench)
                push += self._wrench[0]  # along the normal: the contacts of one face have the same
            self.largest = max(self.largest, push)
        self.tick += 1


def biased(object_name: str, force_n: np.ndarray, sides: tuple[str, ...] = ("left",)):
    """A cell whose arms' torque sensors are off by what this force at the pad would be, where the arm begins."""
    cell = load_description(None)[0]
    faults = []
    for side in sides:
        mounting = getattr(cell, side)
        model = ArmModel(mounting, cell.pad)
        place, _ = end_effector_pose(model, np.array(mounting.home))
        J = model.J0[:3] + np.cross(model.J0[3:].T, place).T
        faults.append({"kind": "tau_sensor_bias", "arm": side, "at_s": 0.0, "bias_Nm": (J.T @ force_n).tolist()})
    return simulated_cell(object_name, 0.0, 0, faults=faults_in({"fault": faults}, ""))


@pytest.fixture
def trial(cell, demonstration):
    """Run a trial with both arms biased; give the result, and the time of the first touch, s, as the plant knows it."""

    def run(force_n: np.ndarray, tare: bool = True):
        parameters = cell_parameters(cell)
        detector = DetectorParameters() if tare else DetectorParameters(tare_n=inf)
        parameters = replace(parameters, detector=detector)
        # the recording is a good robot's
        prepared = prepare_trial(TrialSpecification(str(demonstration.path)), cell, parameters)
        plant = biased("rice_box", force_n, ("left", "right"))
        # the torque loop believes its sensors: biased arms come to the box at another time
        truth = Truth(plant)
        arms = plant.as_cell("direct")
        try:
            result = run_trial(prepared, arms, RunContext())
        finally:
            arms.close()
        return result, 1e-3 * truth.first

    return run


@pytest.mark.parametrize("direction", sampled(DIRECTIONS, "outwards".__eq__))
@pytest.mark.parametrize("newtons", sampled((2.0, 5.0, 8.0), lambda newtons: newtons == 8.0))
def test_an_impact_is_detected_when_it_comes_whatever_the_bias(trial, newtons, direction):
    good, touched_s = trial(np.zeros(3))
    usual_s = good.detected_impact_time_s - touched_s
    result, touched_s = trial(newtons * np.array(DIRECTIONS[direction]))
    assert result.detected_impact_time_s - touched_s == pytest.approx(usual_s, abs=3e-3)
    assert result.success, result.failure_reason


class Still:
    """A link, for arms that are asked for their states and do not move."""


def showing(newtons: float):
    """A plant at rest whose left arm shows this force upwards, N, in each state."""
    plant = simulated_cell(NO_OBJECT, 0.0, 0)
    plant.sensors.sense = lambda: None
    plant.states["O_F_ext_hat_K"][0, :3] = (0.0, 0.0, newtons)
    return plant


def with_link(plant) -> Cell:
    return replace(plant.as_cell("direct"), link=Still())


@pytest.mark.parametrize(("newtons", "says"), [(0.3, ""), (3.0, "left 3.0 N (payload off by +0.31 kg?)")])
def test_what_is_felt_at_rest_is_said_before_a_trial(cell, newtons, says):
    plant = showing(newtons)
    said = check_estimate(with_link(plant), cell, DetectorParameters())
    assert bool(said) == bool(says)
    assert said.endswith(says)
    assert resting_force(with_link(plant), cell)[1] == pytest.approx([0.0] * 3, abs=0.3)


def test_a_trial_is_refused_where_no_impact_could_be_told(cell):
    plant = showing(10.0)
    with pytest.raises(TrialError, match=r"the left arm feels 10\.\d N with nothing at its pad") as refused:
        check_estimate(with_link(plant), cell, DetectorParameters())
    assert "\n" not in str(refused.value)
    plant.states["O_F_ext_hat_K"] = 0.0
    with pytest.raises(TrialError, match="estimates no force at all"):
        check_estimate(with_link(plant), cell, DetectorParameters())


@pytest.mark.parametrize("kind", ["demonstration", "friction"])
def test_no_motion_begins_with_an_arm_that_would_sink(cell, kind):
    """20 N at rest: the pad of a demonstration sank by 10 mm in 0.24 s."""
    run = {
        "demonstration": PreparedDemonstration(DemonstrationSpecification(), cell),
        "friction": PreparedMotion(SweepSpecification("rice_box", 1, 0), cell, None, cell_parameters(cell), 0),
    }[kind]
    with pytest.raises(TrialError, match=r"the left arm feels 20\.\d N .* it would sink"):
        run.look(with_link(showing(20.0)))
    silent = showing(0.0)  # another author's robot, which estimates nothing, moves freely
    silent.states["O_F_ext_hat_K"] = 0.0
    assert run.look(with_link(silent)) == ""


def test_by_the_papers_law_the_same_bias_is_a_missed_impact(trial):
    """Both arms at 8 N: it ends by a bound of the judge's or of the robots'."""
    result, _ = trial(np.array([0.0, 0.0, 8.0]), tare=False)
    assert not result.success
    assert result.detected_impact_time_s is None
    assert re.search(
        "pushes harder|residual|external torque|measured torque|left torque control", result.failure_reason
    )


@pytest.mark.parametrize("share", [1.0, 0.0])
def test_no_motion_begins_with_torques_that_the_judge_would_stop(cell, share):
    """Of another author's robot: its tau_J at rest is zero. Its judge's stop came in the first tick, and named joint 2
    alone."""
    plant = showing(0.3)
    plant.states["tau_J"] *= share
    run = PreparedMotion(SweepSpecification("rice_box", 1, 0), cell, None, cell_parameters(cell), 0)
    if share == 1.0:
        assert run.look(with_link(plant)) == ""
        return
    said = (
        r"the left arm's tau_J leaves gravity out, 2\d\.\d Nm at joint 2: .* allows 20 Nm there.*tau_ext_approach_max"
    )
    with pytest.raises(TrialError, match=said) as refused:
        run.look(with_link(plant))
    assert "\n" not in str(refused.value)
    wide = {"tau_ext_approach_max": [60.0] * 7, "tau_ext_contact_max": [60.0] * 7}
    widened = replace(cell, safety=cell.safety | wide)
    assert PreparedMotion(run.specification, widened, None, run.parameters, 0).look(with_link(plant)) == ""
