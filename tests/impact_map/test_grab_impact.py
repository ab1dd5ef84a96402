"""A planned grab, against the balance of momentum along y, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from rtstack.control.records import POINT
from rtstack.impact_map import Contact, MapKind, SceneError, Status, impact_map, problem_of
from rtstack.impact_map.bodies import moved_to
from rtstack.impact_map.grab import grab_impact, grab_scene, joint_state
from rtstack.planning import GrabPlan, plan_grab
from tests.support.impact_map.scenes import LEFT_Q, MIRROR

MASS = 1.25
BOTH_Q = np.array([LEFT_Q, LEFT_Q * MIRROR])


def ante(cell, speed_left=0.35, speed_right=0.35, speed_z=0.25):
    """What the references of both arms end in: at the box, inwards and upwards."""
    points = np.zeros(2, POINT)
    for point, sign, q in zip(points, (1.0, -1.0), BOTH_Q, strict=True):
        point["position"] = (0.0, sign * 0.15, 0.3)
        point["rotation"] = [[1.0, 0.0, 0.0], [0.0, 0.0, -sign], [0.0, sign, 0.0]]
        point["twist"] = (0.0, -sign * (speed_left if sign > 0.0 else speed_right), speed_z, 0.0, 0.0, 0.0)
        point["xi"] = q[0]
        point["dxi"] = sign * 0.1
    return points


def scene_of(cell, speeds):
    """The grab without friction, and its arms' Jacobians (6, 7) of the pads' faces."""
    points = ante(cell, *speeds, speed_z=0.0)
    states = [joint_state(m, cell.pad, p) for m, p in zip((cell.left, cell.right), points, strict=True)]
    q, dq = np.array(states).transpose(1, 0, 2)
    scene = grab_scene(cell, "rice_box", q, dq, 0.0, 0.0)
    arms = problem_of(scene).bodies[:2]
    return scene, [(arm.M, moved_to(arm.place, arm.origin)) for arm in arms]


def balance(masses, speeds):
    """Return the common velocity along y of two masses at these speeds (left, right: inwards) and a box at rest."""
    (left, right), (v_left, v_right) = masses, speeds
    return (right * v_right - left * v_left) / (left + right + MASS)


@pytest.mark.parametrize("speeds", [(0.35, 0.35), (0.5, 0.2)])
def test_points_that_meet_at_the_centre_line_are_three_masses_in_a_row(cell, speeds):
    scene, arms = scene_of(cell, speeds)
    middle = [
        Contact((side, "object"), 0.0, points=((0.0, sign * 0.15, 0.3),), normal=(0.0, sign, 0.0))
        for side, sign in (("left", 1.0), ("right", -1.0))
    ]
    result = impact_map(replace(scene, contacts=(*middle, scene.contacts[2])))
    masses = [1.0 / (J[1] @ np.linalg.solve(M, J[1])) for M, J in arms]
    v = balance(masses, speeds)
    assert result.single_step.status is Status.SOLVED
    for impact in (result.single_step, result.converged):
        for body in ("left", "right", "object"):
            np.testing.assert_allclose(result.twist(body, impact)[1], v, atol=1e-10)


@pytest.mark.parametrize("speeds", [(0.35, 0.35), (0.5, 0.2)])
def test_faces_on_a_box_that_does_not_turn_are_three_masses_in_a_row(cell, speeds):
    scene, arms = scene_of(cell, speeds)
    heavy = replace(scene.objects["object"], inertia=(1e9, 1e9, 1e9))
    result = impact_map(replace(scene, objects={"object": heavy}))
    # closed faces: no tilt about x and z, before and after, and along y each pad weighs what it then weighs
    masses = [np.linalg.inv(J[[1, 3, 5]] @ np.linalg.solve(M, J[[1, 3, 5]].T))[0, 0] for M, J in arms]
    for body in ("left", "right", "object"):
        np.testing.assert_allclose(result.twist(body)[1], balance(masses, speeds), atol=1e-9)


def test_a_symmetric_grab_ends_with_the_box_between_the_pads_and_on_its_way_up(cell):
    planned = grab_impact(cell, "rice_box", ante(cell), pad_friction=0.9, table_friction=0.4)
    assert planned.map.converged.status is Status.SOLVED
    np.testing.assert_allclose(planned.q, BOTH_Q, atol=1e-5)
    np.testing.assert_allclose(planned.dq_before[:, 0], [0.1, -0.1], atol=1e-12)
    for side, before, twist in zip(("left", "right"), ante(cell)["twist"], planned.twist, strict=True):
        np.testing.assert_allclose(planned.map.twist_before(side), before, atol=1e-10)
        np.testing.assert_array_equal(twist, planned.map.twist(side))
        assert abs(twist[1]) < 0.01  # it is not quite symmetric: links are not their own mirror images
        assert 0.1 < twist[2] < 0.25
    np.testing.assert_array_equal(planned.dxi, planned.dq_after[:, 0])
    np.testing.assert_allclose(planned.map.twist("object")[1], planned.twist[:, 1].mean(), atol=1e-3)


def test_the_papers_single_step_is_a_map_of_its_own(cell):
    """Its pads turn apart from the object, which a plan with it does not follow: it keeps their orientation."""
    planned = grab_impact(cell, "rice_box", ante(cell), 0.9, 0.4, kind=MapKind.SINGLE_STEP)
    for side, twist, dq in zip(("left", "right"), planned.twist, planned.dq_after, strict=True):
        np.testing.assert_array_equal(twist, planned.map.twist(side, planned.map.single_step))
        np.testing.assert_array_equal(dq, planned.map.velocity(side, planned.map.single_step))
        assert np.abs(twist[3:] - planned.map.twist("object", planned.map.single_step)[3:]).max() > 0.1
    request = GrabPlan(speed=0.3, rise=0.25, height=0.03)
    ours, papers = (plan_grab(cell, "rice_box", replace(request, map=kind)) for kind in reversed(MapKind))
    k = ours.recording.impact
    for arm, side in enumerate(("left", "right")):
        for planned, impact in ((ours, ours.map.converged), (papers, papers.map.single_step)):
            np.testing.assert_allclose(planned.velocities[arm], planned.map.twist(side, impact)[:3], atol=1e-12)
        assert np.ptp(papers.recording.points[arm]["rotation"][k:], axis=0).max() < 1e-12
        assert np.ptp(ours.recording.points[arm]["rotation"][k:], axis=0).max() > 1e-3
    assert (ours.as_dict()["parameters"]["map"], papers.as_dict()["parameters"]["map"]) == ("converged", "single_step")


def test_a_pose_out_of_reach_or_away_from_the_object_is_one_line(cell):
    far = ante(cell)
    far["position"][0] = (1.5, 0.15, 0.3)
    with pytest.raises(SceneError, match=r"left arm: no configuration with the pad at \[1\.5, 0\.15, 0\.3\]"):
        grab_impact(cell, "rice_box", far, 0.9, 0.4)
    with pytest.raises(SceneError, match="left does not touch object"):
        grab_impact(cell, "rice_box", ante(cell), 0.9, 0.4, object_xy=(0.0, 0.03))
