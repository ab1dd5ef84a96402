"""Planned references: where they begin, what they meet, how they join, what they feed forward."""

import numpy as np
import pytest

from rtstack.impact_map.grab import grab_impact
from rtstack.planning.joints import feedforward
from rtstack.planning.path import Approach
from rtstack.references.demonstration import end_effector_pose
from rtstack.references.quintic import ViaPoint, quintic_motion
from rtstack.trials.assembly import arm_controllers, default_parameters

GRAVITY = 9.81


def test_the_acceleration_of_a_quintic_is_the_derivative_of_its_velocity():
    points = [ViaPoint(0.1, 0.0), ViaPoint(0.6, 0.2, 0.4), ViaPoint(1.4, -0.1)]
    t = np.arange(0.0, 1.5, 1e-4)
    position, velocity, acceleration = quintic_motion(points, t)
    for value, rate in ((position, velocity), (velocity, acceleration)):
        np.testing.assert_allclose(
            np.gradient(value, t)[1:-1], rate[1:-1], atol=5e-3
        )  # the jerk may jump at a via point
    np.testing.assert_allclose(acceleration[[1000, 6000, 14000]], 0.0, atol=1e-9)


def test_an_approach_never_turns_back():
    start, contact = np.array([0.0, 0.35, 0.26]), np.array([0.0, 0.15, 0.33])
    approach = Approach(start, contact, np.array([0.0, -0.5, 0.3]), -0.3, -0.1)
    touch = 0.2 + approach.least_s(0.05)
    path = approach.path(touch, 0.05)
    t = np.arange(0.0, touch, 1e-3)
    assert quintic_motion(path.y, t)[1].max() <= 1e-12
    assert quintic_motion(path.z, t)[1].min() >= -1e-12
    for vias, place, v in ((path.y, 0.15, -0.5), (path.z, 0.33, 0.3)):
        x, dx, ddx = quintic_motion(vias, np.array([touch - 0.05, touch, touch + 0.2]))
        np.testing.assert_allclose(dx, v, atol=1e-12)
        np.testing.assert_allclose(ddx, 0.0, atol=1e-9)
        np.testing.assert_allclose(x, place + v * np.array([-0.05, 0.0, 0.2]), atol=1e-12)


def test_a_plan_begins_at_home_at_rest_and_ends_at_rest(cell, grabbed, pushed):
    arms = arm_controllers(cell, default_parameters())
    for planned in (grabbed, pushed):
        points = planned.recording.points
        for arm, mounting in enumerate((cell.left, cell.right)):
            position, rotation = end_effector_pose(arms[arm].model, np.array(mounting.home))
            np.testing.assert_allclose(points[arm, 0]["position"], position, atol=1e-12)
            np.testing.assert_allclose(points[arm]["rotation"], np.broadcast_to(rotation, (points.shape[1], 3, 3)))
            np.testing.assert_allclose(planned.joints[arm].q[0], mounting.home, atol=1e-6)
        for point in (points[:, 0], points[:, -1]):
            np.testing.assert_allclose(point["twist"], 0.0, atol=1e-9)


def test_the_references_meet_the_surface_and_jump_as_the_map_says(cell, grabbed):
    reference, k = grabbed.reference, grabbed.recording.impact
    request = grabbed.request
    for arm, sign in ((0, 1.0), (1, -1.0)):
        ante, post = reference.ante[arm, k], reference.post[arm, k]
        np.testing.assert_allclose(ante["position"], (0.0, sign * 0.15, 0.3 + request.height), atol=1e-9)
        np.testing.assert_allclose(post["position"], ante["position"], atol=1e-9)  # (14)
        np.testing.assert_allclose(ante["twist"], (0, -sign * request.speed, request.rise, 0, 0, 0), atol=1e-9)
    friction = cell.contact_friction
    again = grab_impact(cell, "rice_box", reference.ante[:, k], friction.pad, friction.table)
    np.testing.assert_allclose(reference.post[:, k]["twist"][:, :3], 0.9 * again.twist[:, :3], atol=1e-7)
    np.testing.assert_allclose(reference.post[:, k]["dxi"], 0.9 * again.dxi, atol=1e-7)
    assert np.all(reference.post[:, k]["twist"][:, 2] > 0.1)


def test_both_references_go_on_beyond_the_impact(grabbed, pushed):
    for planned in (grabbed, pushed):
        reference, k = planned.reference, planned.recording.impact
        tau = np.arange(-100, 101) * reference.period_s
        for points in (reference.ante, reference.post):
            around = points[:, k - 100 : k + 101]
            held = points is reference.ante
            some = slice(100, None) if held else slice(None, 101)
            straight = points[:, k, None]["position"] + tau[:, None] * points[:, k, None]["twist"][:, :, :3]
            np.testing.assert_allclose(around["position"][:, some], straight[:, some], atol=1e-9)
            np.testing.assert_array_equal(around["twist"][:, some], np.broadcast_to(
                points[:, k if not held else k + 1, None]["twist"], around["twist"][:, some].shape))  # fmt: skip


def test_what_is_carried_is_fed_forward_and_nothing_before(grabbed):
    recording, k = grabbed.recording, grabbed.recording.impact
    force = grabbed.force
    assert not force[:, :k].any()
    weight = 1.25 * GRAVITY
    carried = slice(k, recording.release)
    lifting = recording.points["twist"][:, carried, 2].mean(axis=0)
    rising = np.gradient(lifting, recording.period_s)
    np.testing.assert_allclose(force[:, carried, 2].sum(axis=0)[2:-2], weight + 1.25 * rising[2:-2], atol=0.05)
    np.testing.assert_allclose(force[0, carried, 1] - force[1, carried, 1], -80.0, atol=1e-9)  # 40 N each, inwards
    assert not force[:, -1].any()
    # the ante-impact reference carries the object from the nominal impact on, but squeezes nothing
    reference = grabbed.reference
    np.testing.assert_allclose(reference.ante[:, k + 50]["wrench_ff"][:, 2], weight / 2, atol=0.1)
    np.testing.assert_allclose(reference.ante[:, k + 50]["wrench_ff"][:, 1], 0.0, atol=0.2)


def test_a_push_feeds_forward_the_friction_of_the_table(pushed):
    k = pushed.recording.impact
    np.testing.assert_allclose(pushed.force[0, k, 1], -0.4 * 1.3 * GRAVITY, atol=1e-6)
    assert not pushed.force[1].any()
    assert np.all(pushed.force[0, k : pushed.recording.release, 1] < 0.0)  # it never has to pull


def test_the_feedforward_moves_the_pad_as_planned_and_exerts_the_force(grabbed):
    """By the equations of motion: an arm that is pushed back with the force accelerates as the path does."""
    motion, points, k = grabbed.joints[0], grabbed.recording.points[0], grabbed.recording.impact
    acceleration = np.zeros((points.shape[0], 4))
    velocity = np.concatenate([points["twist"][:, :3], points["dxi"][:, None]], axis=1)
    for some in (slice(None, k), slice(k, None)):
        acceleration[some] = np.gradient(velocity[some], grabbed.recording.period_s, axis=0)
    wrench, beta = feedforward(motion, acceleration, grabbed.force[0], 0)
    for tick in (k - 300, k + 400, k + 900):
        J, M = motion.J[tick], motion.M[tick]
        task = np.vstack([J, np.eye(7)[0]])
        wanted = np.append(J @ np.linalg.solve(M, J.T) @ wrench[tick], beta[tick])  # what the controller aims at
        ddq = np.linalg.solve(task, wanted)
        pushed_back = ddq - np.linalg.solve(M, J[:3].T @ grabbed.force[0, tick])
        np.testing.assert_allclose(task[[0, 1, 2, 6]] @ pushed_back, acceleration[tick], atol=1e-9)


@pytest.mark.parametrize("arm", [0, 1])
def test_the_joints_go_where_the_path_goes(cell, grabbed, arm):
    motion, points = grabbed.joints[arm], grabbed.recording.points[arm]
    model = arm_controllers(cell, default_parameters())[arm].model
    for tick in (0, 705, grabbed.recording.impact, grabbed.recording.impact - 1, 3004):
        position, rotation = end_effector_pose(model, motion.q[tick])
        np.testing.assert_allclose(position, points[tick]["position"], atol=1e-6)
        np.testing.assert_allclose(rotation, points[tick]["rotation"], atol=1e-6)
        np.testing.assert_allclose(motion.J[tick] @ motion.dq[tick], points[tick]["twist"], atol=1e-4)
    np.testing.assert_allclose(np.gradient(motion.q[:700], 1e-3, axis=0)[1:-1], motion.dq[1:699], atol=1e-4)
