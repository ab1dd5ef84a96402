"""Planned references: where they begin, what they meet, how they join, what they feed forward."""

from dataclasses import replace

import numpy as np
import pytest

from rtstack.impact_map.grab import grab_impact
from rtstack.planning import GrabPlan, plan_grab, plan_push
from rtstack.planning.joints import feedforward, held_back, repaid
from rtstack.planning.path import Approach, ArmPath, points_along
from rtstack.references.demonstration import end_effector_pose
from rtstack.references.quintic import ViaPoint, quintic_motion
from rtstack.trials.assembly import arm_controllers, default_parameters

GRAVITY = 9.81
SQUEEZE_TICKS = 30


def test_the_acceleration_of_a_quintic_is_the_derivative_of_its_velocity():
    points = [ViaPoint(0.1, 0.0), ViaPoint(0.6, 0.2, 0.4, -1.5), ViaPoint(1.4, -0.1)]
    t = np.arange(0.0, 1.5, 1e-4)
    position, velocity, acceleration = quintic_motion(points, t)
    for value, rate in ((position, velocity), (velocity, acceleration)):
        np.testing.assert_allclose(
            np.gradient(value, t)[1:-1], rate[1:-1], atol=5e-3
        )  # the jerk may jump at a via point
    np.testing.assert_allclose(acceleration[[1000, 6000, 14000]], [0.0, -1.5, 0.0], atol=1e-9)


def test_a_quintic_between_points_of_a_parabola_is_the_parabola():
    t = np.linspace(0.2, 0.7, 50)[:-1]
    at = [ViaPoint(s, 0.3 * s - 0.8 * s**2, 0.3 - 1.6 * s, -1.6) for s in (0.2, 0.7)]
    position, velocity, acceleration = quintic_motion(at, t)
    np.testing.assert_allclose(position, 0.3 * t - 0.8 * t**2, atol=1e-12)
    np.testing.assert_allclose(velocity, 0.3 - 1.6 * t, atol=1e-12)
    np.testing.assert_allclose(acceleration, -1.6, atol=1e-10)


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
            before = points[arm]["rotation"][: planned.recording.impact]
            np.testing.assert_allclose(before, np.broadcast_to(rotation, before.shape))
            np.testing.assert_allclose(points[arm, -1]["rotation"], rotation, atol=1e-12)
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
    np.testing.assert_allclose(reference.post[:, k]["twist"], 0.9 * again.twist, atol=1e-7)
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
    squeeze = (force[1, carried, 1] - force[0, carried, 1]) / 2.0  # inwards
    np.testing.assert_allclose(squeeze[SQUEEZE_TICKS:], 40.0, atol=1e-9)
    np.testing.assert_allclose(np.diff(squeeze[: SQUEEZE_TICKS + 1]), 40.0 / SQUEEZE_TICKS, atol=1e-9)
    assert not force[:, -1].any()
    assert not grabbed.recording.points["wrench_ff"][:, k - 1, :3].round(6).any()


def test_momentum_lifts_first(grabbed):
    k, reference = grabbed.recording.impact, grabbed.reference
    free = slice(k, k + 100)
    rising = grabbed.acceleration[:, free, 2]
    assert np.all(rising < -0.5)
    np.testing.assert_allclose(rising, rising[0, 0], atol=1e-9)
    # both arms together: each has another inertia upwards along the way, and 1.25 kg weigh 12.3 N
    for points in (grabbed.recording.points, reference.ante):
        np.testing.assert_allclose(points["wrench_ff"][:, free, 2].sum(axis=0), 0.0, atol=1.5)
    np.testing.assert_allclose(reference.post["wrench_ff"][:, : k - 1, 2], 0.0, atol=0.1)


@pytest.mark.parametrize(("rise", "scale", "left"), [(0.08, 1.0, 1.0), (0.15, 1.0, 1 / 3), (0.15, 0.5, 1 / 6)])
def test_momentum_never_takes_all_of_the_speed(cell, rise, scale, left):
    asked = GrabPlan(speed=0.3, rise=rise, height=0.03, momentum_s=0.2, post_impact_scale=scale)
    planned = plan_grab(cell, "rice_box", asked)
    rising = planned.recording.points["twist"][0, planned.recording.impact :, 2]
    assert rising[:300].min() / rising[0] == pytest.approx(left, abs=0.02)


def test_without_momentum_the_weight_comes_with_the_nominal_impact(cell):
    planned = plan_grab(cell, "rice_box", GrabPlan(speed=0.3, rise=0.22, height=0.03, momentum_s=0.0))
    k, reference, weight = planned.recording.impact, planned.reference, 1.25 * GRAVITY
    # the ante-impact reference carries the object from then on, but squeezes nothing
    np.testing.assert_allclose(reference.ante[:, k + 50]["wrench_ff"][:, 2], weight / 2, atol=0.1)
    np.testing.assert_allclose(reference.ante[:, k + 50]["wrench_ff"][:, 1], 0.0, atol=0.2)
    # nor does the post-impact one before it: the first contact of a box out of its place is early, the second one late
    np.testing.assert_allclose(reference.post[:, k - 1]["wrench_ff"][:, 2], 0.0, atol=0.1)


def test_a_push_feeds_forward_the_friction_of_the_table(pushed):
    k = pushed.recording.impact
    velocity = pushed.velocities[0, :2]  # which the impact has turned aside: friction acts along it, not along the push
    assert abs(velocity[0]) > 0.02
    np.testing.assert_allclose(
        pushed.force[0, k, :2], 0.4 * 1.3 * GRAVITY * velocity / np.linalg.norm(velocity), atol=2e-3
    )
    # its one pad may meet the box early, and pushes it from then on
    reference = pushed.reference
    np.testing.assert_array_equal(reference.post[0, k - 1]["wrench_ff"], reference.post[0, k]["wrench_ff"])
    assert not pushed.force[1].any()
    assert np.all(pushed.force[0, k : pushed.recording.release, 1] < 0.0)  # it never has to pull


def test_the_feedforward_moves_the_pad_as_planned_and_exerts_the_force(grabbed):
    """By the equations of motion: an arm that is pushed back with the force accelerates as the path does."""
    motion, points, k = grabbed.joints[0], grabbed.recording.points[0], grabbed.recording.impact
    acceleration = np.zeros((points.shape[0], 7))
    velocity = np.concatenate([points["twist"], points["dxi"][:, None]], axis=1)
    for some in (slice(None, k), slice(k, None)):
        acceleration[some] = np.gradient(velocity[some], grabbed.recording.period_s, axis=0)
    reaction = np.einsum("nij,ni->nj", motion.J[:, :3], grabbed.force[0])
    wrench, beta = feedforward(motion, acceleration, reaction, 0)
    for tick in (k - 300, k + 400, k + 900):
        J, M = motion.J[tick], motion.M[tick]
        task = np.vstack([J, np.eye(7)[0]])
        wanted = np.append(J @ np.linalg.solve(M, J.T) @ wrench[tick], beta[tick])  # what the controller aims at
        ddq = np.linalg.solve(task, wanted)
        pushed_back = ddq - np.linalg.solve(M, J[:3].T @ grabbed.force[0, tick])
        np.testing.assert_allclose(task @ pushed_back, acceleration[tick], atol=1e-9)


def test_accelerations_are_those_of_the_middle_of_a_held_torque():
    """So that what a torque that is held for a tick adds is the velocity that the next point has."""
    vias = [ViaPoint(0.0, 0.0), ViaPoint(0.15, 0.03, 0.4)]
    path = ArmPath(vias, vias, vias, vias)
    points, acceleration = points_along(path, np.eye(3), np.arange(0.0, 0.15, 1e-3), 1e-3)
    gathered = np.cumsum(acceleration[:-1, 2]) * 1e-3
    np.testing.assert_allclose(gathered, points["twist"][1:, 2], atol=2e-5)  # half a tick late: 2e-3


def test_what_the_torque_rate_holds_back_is_repaid():
    """A robot that follows a step of torque by 1 Nm a tick has given as much as the step a little later."""
    step = np.array([5.4, -3.0, 0.7, 1.0, 0.0, -1.2, 2.5])
    wanted = np.tile(step, (100, 1)) + repaid(held_back(step, 1000.0, 1e-3), 100, 1e-3)
    given, torque = np.zeros(7), np.zeros(7)
    for tick in wanted:
        torque += np.clip(tick - torque, -1.0, 1.0)
        given += torque * 1e-3
    np.testing.assert_allclose(given, 0.1 * step, atol=5e-4)  # 0.012 Nms less without


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


def test_a_pad_that_gives_way_is_asked_to_be_where_its_force_puts_it(cell, grabbed, pushed):
    """By 2e-5 m/N: under the squeeze of a grab, and under the object's friction on the table in a push."""
    weight = cell.objects["box_130"].mass * GRAVITY
    for rigid, plan, gives in (
        (grabbed, plan_grab(cell, "rice_box", replace(grabbed.request, give=2e-5)), 2e-5 * grabbed.request.squeeze),
        (pushed, plan_push(cell, "box_130", replace(pushed.request, give=2e-5)), 2e-5 * 0.4 * weight),
    ):
        before, after = (planned.recording.points[0]["position"][:, 1] for planned in (rigid, plan))
        impact, release = rigid.recording.impact, min(rigid.recording.release, plan.recording.release)
        np.testing.assert_allclose(before[: impact + 1], after[: impact + 1], atol=1e-9)
        assert before[release] - after[release] == pytest.approx(gives, rel=0.05)  # the left arm pushes along -y
        np.testing.assert_allclose(plan.velocities, rigid.velocities, atol=1e-9)


@pytest.mark.parametrize("plan", [plan_grab, plan_push])
def test_the_pads_meet_the_object_flat_however_home_has_them(cell, plan):
    """Bases that are turned turn the pads at home with them."""
    half = np.radians(3.0) / 2.0
    turned = replace(
        cell,
        left=replace(cell.left, base_orientation_wxyz=(float(np.cos(half)), 0.0, 0.0, float(np.sin(half)))),
        right=replace(cell.right, base_orientation_wxyz=(float(np.cos(half)), float(np.sin(half)), 0.0, 0.0)),
    )
    planned = plan(turned, "rice_box")
    arms = arm_controllers(turned, default_parameters())
    points, k = planned.recording.points, planned.recording.impact
    steady = k - round(1e3 * planned.request.steady_s)
    for arm, mounting in enumerate((turned.left, turned.right)):
        _, rotation = end_effector_pose(arms[arm].model, np.array(mounting.home))
        np.testing.assert_allclose(points[arm, 0]["rotation"], rotation, atol=1e-12)
        np.testing.assert_allclose(planned.joints[arm].q[0], mounting.home, atol=1e-6)
        if arm == 1 and plan is plan_push:
            continue  # it gives way
        face = points[arm, steady:k]["rotation"][:, :, 2]
        np.testing.assert_allclose(face, np.broadcast_to((0.0, (-1.0, 1.0)[arm], 0.0), face.shape), atol=1e-12)
