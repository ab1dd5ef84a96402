"""What friction compensation leaves along a reference: a force that is known is found in a free run, and then gone."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rtstack.papers.impact_maps.feedback import AFTER_S
from rtstack.papers.impact_maps.worker import WINDOW, average, residual
from rtstack.planning import PushPlan, plan_grab, plan_push
from rtstack.planning.free import PlanPhase, compensated, free_motion
from rtstack.trials.assembly import arm_controllers, default_parameters
from rtstack.trials.move import run_motion
from sim_robot.cell import SimulatedCell
from sim_robot.plant import Plant
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import load_scene

FORCE_N = np.array([0.6, -1.0, 0.8])  # on the left pad: what 3 % of a push of 2.2 kg is made of


@pytest.fixture(scope="module")
def parameters():
    """The paper's tasks."""
    parameters = default_parameters()
    control = replace(parameters.control, acceleration_tasks=True, stiffness=np.full(6, 100.0), posture_gain=100.0)
    return replace(parameters, control=control)


@pytest.fixture(scope="module")
def pushed(cell):
    return plan_push(cell, "box_130", PushPlan(speed=0.5))


def run_free(free, cell, parameters, force):
    """Run a free motion on arms without scatter, a constant force on the left pad, nothing in the way."""
    scene, plant_parameters = load_scene(), load_plant_parameters().nominal()
    plant = Plant.nominal(scene, plant_parameters, "box_130")
    plant.push(0, force)
    simulated = SimulatedCell(plant, scene, plant_parameters, 0, empty=True).as_cell("direct")
    try:
        reason, columns = run_motion(free.plan, cell, parameters, simulated)
    finally:
        simulated.close()
    assert reason is None
    return columns


@pytest.mark.parametrize("part", list(PlanPhase))
def test_a_constant_force_is_found_and_compensated(cell, parameters, pushed, part):
    free = free_motion(pushed, cell, part, parameters.control, AFTER_S)
    arms = arm_controllers(cell, parameters)
    without = residual(run_free(free, cell, parameters, np.zeros(3)), free, arms)
    found = residual(run_free(free, cell, parameters, FORCE_N), free, arms)
    ticks = slice(free.begin, free.end)
    motion = pushed.joints[0]
    reaction = np.linalg.solve(motion.M[ticks], motion.J[ticks].transpose(0, 2, 1))  # M^-1 J^T
    needed = -np.concatenate([motion.J[ticks] @ reaction, reaction[:, :1]], axis=1)[:, :, :3] @ FORCE_N
    # from 0.2 s on: before, the controller has not met the force, which was there from the first tick. Within 10 %:
    # a pad that is pushed goes at another velocity, and has another friction
    late = slice(200 if part is PlanPhase.ANTE else 0, None)
    np.testing.assert_allclose((found - without)[0, late, :3], needed[late, :3], atol=0.1 * np.abs(needed[:, :3]).max())
    of_the_force, largest = (found - without)[0, late].mean(axis=0), np.abs(needed).max()
    np.testing.assert_allclose(of_the_force, needed[late].mean(axis=0), atol=0.1 * largest)
    np.testing.assert_allclose(found[1], without[1], atol=1e-3)
    # fed forward along the reference, it leaves nothing to feedback, nor has it any effect
    acceleration = np.zeros((2, pushed.recording.points.shape[1], 7))
    acceleration[:, ticks] = average([found, found], 0.0, free.plan.period_s)
    points = compensated(pushed, acceleration).recording.points
    for name in ("wrench_ff", "beta"):
        free.plan.ante[name][:, ticks] += points[name][:, ticks] - pushed.recording.points[name][:, ticks]
    left = residual(run_free(free, cell, parameters, FORCE_N), free, arms)[0, 200:-WINDOW]
    assert np.abs(left.mean(axis=0)).max() < 0.05 * largest
    assert abs(left[:, 1].mean()) < 0.02 * abs(found[0, 200:-WINDOW, 1].mean())


def test_a_part_is_the_plan_and_leads_there_and_to_rest(cell, parameters, pushed):
    k = pushed.recording.impact
    for part, begin, end in ((PlanPhase.ANTE, 0, k), (PlanPhase.POST, k, k + 600)):
        free = free_motion(pushed, cell, part, parameters.control, AFTER_S)
        assert (free.begin, free.end) == (begin, end)
        for name in ("position", "rotation", "twist", "xi", "dxi"):
            np.testing.assert_array_equal(
                free.plan.ante[name][:, begin:end], pushed.recording.points[name][:, begin:end]
            )
        velocity = free.plan.ante["twist"][:, :, :3]
        assert np.abs(np.diff(velocity, axis=1)).max() < 0.02  # nothing jumps
        np.testing.assert_allclose(np.diff(free.plan.ante["position"], axis=1) / 1e-3, velocity[:, 1:], atol=0.01)
        assert not free.plan.ante["wrench_ff"][:, -1].any() or np.abs(velocity[:, -1]).max() < 1e-3
        assert np.abs(velocity[:, 0]).max() == 0.0
    # nothing of the object is left in it: at the impact's velocity, which is constant, the feedforward is none
    np.testing.assert_allclose(free.plan.ante["wrench_ff"][0, k, :3], 0.0, atol=0.01)
    assert np.abs(pushed.recording.points["wrench_ff"][0, k, 1]) > 4.0


def test_pads_that_turn_after_a_grab_turn_as_smoothly_in_a_free_run(cell, parameters):
    grabbed = plan_grab(cell, "box_130")
    k, free = grabbed.recording.impact, free_motion(grabbed, cell, PlanPhase.POST, parameters.control, AFTER_S)
    points = free.plan.ante
    assert np.abs(points["twist"][:, k, 3:]).max() > 0.02
    for arm in range(2):
        assert np.abs(np.diff(points["twist"][arm], axis=0)).max() < 0.02
        turned = Rotation.from_matrix(points["rotation"][arm, 1:] @ points["rotation"][arm, :-1].swapaxes(1, 2))
        np.testing.assert_allclose(turned.as_rotvec() / 1e-3, points["twist"][arm, 1:, 3:], atol=2e-3)
