"""Motions of arms that stand anywhere: put down what is held, open, go to the start. Over the simulated cell."""

import numpy as np
import pytest

from hal.robot_errors import error_bit
from rtstack.cells import load_description, open_cell
from rtstack.log.reader import read_log
from rtstack.samples import Mode
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.errors import TrialError
from rtstack.trials.move import PreparedMove
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification, HandMotion, MoveSpecification
from sim_robot.cell import simulated_cell
from tests.support.plant_object import object_pose
from tests.support.runs import StopAfter

LIFTED_TICKS = 3300  # of the scripted demonstration: the object is in the air, carried
OBJECT = "rice_box"


@pytest.fixture
def simulated():
    """Give a simulated cell whose arms have been stopped while they carried the object, and its description."""
    description, _ = load_description(None)
    plant = simulated_cell(OBJECT, 0.0, 0)
    cell = plant.as_cell("direct")
    context = RunContext(stop=StopAfter(LIFTED_TICKS))
    run_demonstration(DemonstrationSpecification(OBJECT), description, cell, context)
    yield plant, cell, description
    cell.close()


def asked(motion, description, cell, context=None):
    prepared = PreparedMove(MoveSpecification(motion, OBJECT), description)
    prepared.look(cell)
    return prepared.run(cell, context or RunContext())


@pytest.mark.parametrize(
    ("y_m", "said"), [(0.0, ""), (-0.27, "rice_box stands where the right pad starts: take it away")]
)
def test_an_object_where_a_pad_starts_is_a_line_before_anything_moves(simulated, monkeypatch, y_m, said):
    """Where a push leaves it: on the way home the right arm would press on it from above."""
    _, cell, description = simulated
    asked(HandMotion.PUT_DOWN, description, cell)
    asked(HandMotion.OPEN, description, cell)
    pose = cell.tracker.latest()
    pose.record["position"][0] = (0.0, y_m, description.table.top_z + description.objects[OBJECT].size[2] / 2.0)
    pose.record["orientation_wxyz"][0] = (1.0, 0.0, 0.0, 0.0)
    monkeypatch.setattr(type(cell.tracker), "latest", lambda tracker: pose)
    prepared = PreparedMove(MoveSpecification(HandMotion.START, OBJECT), description)
    if not said:
        prepared.look(cell)
        return
    with pytest.raises(TrialError, match=said):
        prepared.look(cell)


def height(plant, description):
    """How far the object's lower face is above the table, m."""
    place, _ = object_pose(plant.plant)
    return place[2] - description.objects[OBJECT].size[2] / 2.0 - description.table.top_z


def test_what_is_held_is_put_down_after_a_stop_and_the_arms_go_to_the_start(simulated):
    plant, cell, description = simulated
    held = height(plant, description)
    assert held > 0.1
    with pytest.raises(TrialError, match="above the table, and would fall: put it down first"):
        asked(HandMotion.OPEN, description, cell)
    with pytest.raises(TrialError, match="put it down first"):
        asked(HandMotion.START, description, cell)
    assert height(plant, description) == pytest.approx(held, abs=2e-3)

    result = asked(HandMotion.PUT_DOWN, description, cell)
    assert (result.success, result.failure_reason, result.safety_interventions) == (True, None, 0)
    assert result.lowered_mm == pytest.approx(1e3 * held, abs=15.0)
    assert abs(height(plant, description)) < 2e-3
    forces = [np.linalg.norm(arm.read().record["O_F_ext_hat_K"][0, :3]) for arm in (cell.left, cell.right)]
    assert max(forces) < 3.0  # neither pad touches it any more

    with pytest.raises(TrialError, match="nothing is held"):
        asked(HandMotion.PUT_DOWN, description, cell)
    before, _ = object_pose(plant.plant)
    before = np.array(before)
    assert asked(HandMotion.START, description, cell).success
    for arm, mounting in ((cell.left, description.left), (cell.right, description.right)):
        np.testing.assert_allclose(arm.read().q, mounting.home, atol=0.03)
    np.testing.assert_allclose(object_pose(plant.plant)[0], before, atol=1e-3)  # nothing was touched on the way
    assert asked(HandMotion.OPEN, description, cell).success


def test_it_is_put_down_after_a_fault_too(simulated):
    plant, cell, description = simulated
    plant.boxes[0].trip(error_bit("cartesian_reflex"))
    cell.left.recover()
    assert asked(HandMotion.PUT_DOWN, description, cell).success
    assert abs(height(plant, description)) < 2e-3


def test_a_stop_while_it_comes_down_leaves_it_held(simulated):
    plant, cell, description = simulated
    result = asked(HandMotion.PUT_DOWN, description, cell, RunContext(stop=StopAfter(1000)))
    assert not result.success
    assert height(plant, description) > 0.05
    assert asked(HandMotion.PUT_DOWN, description, cell).success


def test_the_log_of_a_motion_says_what_it_was_and_the_judge_changed_nothing(tmp_path):
    description, file = load_description(None)
    cell = open_cell("direct", OBJECT, 0.0, 0)
    specification = MoveSpecification(HandMotion.OPEN, OBJECT)
    opened = open_log(tmp_path / "open.mcap", specification, description, cell.name, file, cell=cell)
    result = asked(HandMotion.OPEN, description, cell, RunContext(log=opened))
    cell.close()
    assert result.success
    log = read_log(tmp_path / "open.mcap")
    assert log.metadata["trial"]["kind"] == "move"
    for side, outwards in (("left", 1.0), ("right", -1.0)):
        control = log.topic(f"/{side}/control")
        moving = control[control["mode"] == Mode.TELEOPERATION]
        way = moving["pose_ref"][:, 1]
        assert 0.01 < outwards * (way[-1] - way[0]) < 0.09  # as far as the box of the judge lets it
        assert np.abs(moving["twist_ref"][:, :3]).max() < 0.13
