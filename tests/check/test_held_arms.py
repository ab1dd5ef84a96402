"""`rtstack check` holds the arms and judges whether they stay, whatever their robots compensate."""

from dataclasses import replace

import numpy as np
import pytest

from hal.cell import Cell
from rtstack.bench.hold import GOOD_RAD, STILL_RAD, STILL_RAD_S, ArmMoved
from rtstack.bench.link import bench_link
from rtstack.cli.check import held_findings
from rtstack.model.cell_description import CellDescription
from sim_robot.cell import simulated_cell
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import NO_OBJECT

TICKS = 3000


def cell_with(gravity_compensation: float, seed: int) -> Cell:
    """An empty cell whose robots are off by this share of each joint's gravity torque (standard deviation)."""
    parameters = load_plant_parameters()
    scatter = replace(parameters.scatter, gravity_compensation=gravity_compensation)
    parameters = replace(parameters, scatter=scatter)
    return simulated_cell(NO_OBJECT, 0.0, seed, parameters=parameters).as_cell("direct")


@pytest.mark.parametrize("seed", range(5))
def test_arms_whose_weight_is_carried_stay_where_they_are(seed: int) -> None:
    figures = bench_link(cell_with(0.005, seed), TICKS)
    assert max(figures.hold_rad) < 0.5 * GOOD_RAD
    assert max(figures.hold_rad_s) < 0.1 * STILL_RAD_S
    hold, link = held_findings(cell_with(0.005, seed), TICKS)
    assert (hold.name, hold.verdict, link.name) == ("hold", "pass", "link")


def test_arms_whose_weight_is_nearly_carried_are_a_warning() -> None:
    hold, _ = held_findings(cell_with(0.05, 2), TICKS)
    assert (hold.name, hold.verdict) == ("hold", "warn")
    assert hold.cost
    assert hold.advice


@pytest.mark.parametrize("gravity_compensation", [0.5, 1.0])
@pytest.mark.parametrize("seed", range(5))
def test_arms_whose_weight_is_not_carried_are_held_stopped_and_told(gravity_compensation: float, seed: int) -> None:
    cell = cell_with(gravity_compensation, seed)
    arms = cell.left, cell.right
    starts = [arm.read().q.copy() for arm in arms]
    (finding,) = held_findings(cell, TICKS)
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
        bench_link(cell_with(gravity_compensation, seed), TICKS)


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
