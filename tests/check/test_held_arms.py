"""`rtstack check` holds the arms and judges whether they stay, whatever their robots compensate."""

import re
from dataclasses import replace

import numpy as np
import pytest

from hal.cell import Cell
from hal.errors import CommandRejected
from rtstack.bench.hold import GOOD_RAD, STILL_RAD, STILL_RAD_S, ArmMoved
from rtstack.bench.link import bench_link
from rtstack.cli.link import held_findings
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.references.demonstration import end_effector_pose
from sim_robot.cell import simulated_cell
from sim_robot.faults.file import faults_in
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import NO_OBJECT
from tests.support.sampling import sampled

TICKS = 3000


def cell_with(gravity_compensation: float, seed: int) -> Cell:
    """An empty cell whose robots are off by this share of each joint's gravity torque (standard deviation)."""
    parameters = load_plant_parameters()
    scatter = replace(parameters.scatter, gravity_compensation=gravity_compensation)
    parameters = replace(parameters, scatter=scatter)
    return simulated_cell(NO_OBJECT, 0.0, seed, parameters=parameters).as_cell("direct")


@pytest.mark.parametrize("seed", sampled(range(5), lambda seed: seed < 2))
def test_arms_whose_weight_is_carried_stay_where_they_are(seed: int, cell: CellDescription) -> None:
    figures = bench_link(cell_with(0.005, seed), TICKS, cell)
    assert max(figures.hold_rad) < 0.5 * GOOD_RAD
    assert max(figures.hold_rad_s) < 0.1 * STILL_RAD_S
    hold, link = held_findings(cell_with(0.005, seed), TICKS, cell)[:2]
    assert (hold.name, hold.verdict, link.name) == ("hold", "pass", "link")


def test_arms_whose_weight_is_nearly_carried_are_a_warning(cell: CellDescription) -> None:
    hold = held_findings(cell_with(0.05, 2), TICKS, cell)[0]
    assert (hold.name, hold.verdict) == ("hold", "warn")
    assert hold.cost
    assert hold.advice


@pytest.mark.parametrize("gravity_compensation", [0.5, 1.0])
@pytest.mark.parametrize("seed", sampled(range(5), lambda seed: seed < 2))
def test_arms_whose_weight_is_not_carried_are_held_stopped_and_told(
    gravity_compensation: float, seed: int, cell: CellDescription
) -> None:
    held = cell_with(gravity_compensation, seed)
    arms = held.left, held.right
    starts = [arm.read().q.copy() for arm in arms]
    (finding,) = held_findings(held, TICKS, cell)
    assert (finding.name, finding.verdict) == ("hold", "fail")
    assert finding.value.startswith("joint ")
    assert "although it was held" in finding.value
    assert "\n" not in finding.value
    assert finding.cost
    assert finding.advice
    for arm, start in zip(arms, starts, strict=True):
        state = arm.read()
        assert np.abs(state.q - start).max() < 2.0 * STILL_RAD
        assert np.abs(state.record["dq"]).max() < 2.0 * STILL_RAD_S
    with pytest.raises(ArmMoved):
        bench_link(cell_with(gravity_compensation, seed), TICKS, cell)


RESTING = ["left pad", "left torques", "left estimate", "right pad", "right torques", "right estimate"]


def lacks(description: CellDescription) -> dict[str, str]:
    """What is found about arms that rest, where it is no pass."""
    found = held_findings(cell_with(0.005, 0), 500, description)[2:]
    assert [finding.name for finding in found] == RESTING
    return {finding.name: finding.value for finding in found if finding.verdict != "pass"}


def test_arms_that_say_what_their_cell_is_told_pass(cell: CellDescription) -> None:
    assert lacks(cell) == {}


def test_arms_that_carry_another_tool_than_their_cell_is_told_are_a_warning(cell: CellDescription) -> None:
    found = lacks(replace(cell, pad=replace(cell.pad, flange_to_face=cell.pad.flange_to_face + 0.02)))
    assert list(found) == ["left pad", "right pad"]
    assert "O_T_EE is 20.0 mm" in found["left pad"]
    found = lacks(replace(cell, pad=replace(cell.pad, mass=3.0)))
    assert list(found) == ["left torques", "right torques"]


# what a held arm feels


def biased_cell(bias_Nm: np.ndarray, arm: str = "left") -> Cell:
    """An empty cell; the torque sensors of one of its arms are off from the start on."""
    fault = {"kind": "tau_sensor_bias", "arm": arm, "at_s": 0.0, "bias_Nm": bias_Nm.tolist()}
    faults = faults_in({"fault": [fault]}, "")
    return simulated_cell(NO_OBJECT, 0.0, 0, faults=faults).as_cell("direct")


def payload(cell: CellDescription, kg: float) -> np.ndarray:
    """The torques (7,), Nm, by which the left arm holds this mass at its pad, where it stands."""
    model = ArmModel(cell.left, cell.pad)
    place, _ = end_effector_pose(model, np.array(cell.left.home))
    rising = model.J0[2] + model.J0[3] * place[1] - model.J0[4] * place[0]
    return 9.81 * kg * rising


@pytest.mark.parametrize("kg", [0.35, -0.5])
def test_a_payload_that_is_off_is_found_in_kilograms(cell: CellDescription, kg: float) -> None:
    found = {one.name: one for one in held_findings(biased_cell(payload(cell, kg)), TICKS, cell)}
    estimate = found["left estimate"]
    assert estimate.verdict == "fail"
    said = re.search(r"force (\S+) N; a payload that is off by (\S+) kg would leave (\S+) Nm of them", estimate.value)
    assert said is not None
    force, mass, left = map(float, said.groups())
    assert force == pytest.approx(9.81 * abs(kg), abs=0.5)
    assert mass == pytest.approx(kg, abs=0.03)
    assert left < 0.2
    assert "\n" not in estimate.value
    assert found["right estimate"].verdict == "pass"


@pytest.mark.parametrize(("torque", "verdict"), [(0.8, "pass"), (1.2, "fail")])
def test_one_newton_metre_at_rest_is_the_bound(cell: CellDescription, torque: float, verdict: str) -> None:
    bias = np.zeros(7)
    bias[3] = torque
    found = {one.name: one for one in held_findings(biased_cell(bias, "right"), 1000, cell)}
    assert found["right estimate"].verdict == verdict
    assert f"{torque:.2f}+-0.0" in found["right estimate"].value


def test_the_judge_of_the_hold_has_the_small_forces(cell: CellDescription) -> None:
    bias = np.zeros(7)
    bias[1] = 25.0
    (finding,) = held_findings(biased_cell(bias), TICKS, cell)
    assert (finding.name, finding.verdict) == ("hold", "fail")
    assert "the left arm was stopped by its judge: the pad pushes harder than this phase allows" in finding.value


class Stop:
    """A stop that was asked for."""

    stop_requested = True


def test_a_key_that_is_let_go_ends_the_hold(cell: CellDescription) -> None:
    (finding,) = held_findings(cell_with(0.005, 0), TICKS, cell, Stop())
    assert (finding.verdict, "before its time" in finding.value) == ("fail", True)


class _Broken:
    """A link that breaks as soon as the arms are started."""

    def start(self) -> None:
        raise CommandRejected("communication_constraints_violation")

    def stop(self, first: int = 1, *, at_rest: bool = False) -> None:
        """Do nothing."""


def test_torques_without_gravity_are_named_where_the_link_breaks(cell: CellDescription) -> None:
    plant = simulated_cell(NO_OBJECT, 0.0, 0)
    plant.sensors.sense = lambda: None  # type: ignore[method-assign]
    plant.states["tau_J"][0] = 0.0
    torques, link = held_findings(replace(plant.as_cell("direct"), link=_Broken()), TICKS, cell)
    assert (torques.name, torques.verdict, link.value) == ("left torques", "warn", "broken")
    assert re.fullmatch(r"tau_J leaves gravity out, 2\d\.\d Nm at joint 2", torques.value)
