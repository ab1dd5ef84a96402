"""A dual-arm grab, planned: approach, impact, lift, carry, put down, release."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hal.base.arrays import Array
from rtstack.impact_map import MapKind, SceneError
from rtstack.impact_map.grab import grab_impact, joint_state_near
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.planning.feasibility import GRAVITY, check_place, feasible, object_named
from rtstack.planning.joints import arm_inertia
from rtstack.planning.path import Approach, ArmPath, coast, common_touch_s, points_along
from rtstack.planning.planned import PlannedMotion, Timing, assemble
from rtstack.planning.request import GrabPlan, PlanError
from rtstack.references.demonstration import end_effector_pose, turn_to_object
from rtstack.references.quintic import ViaPoint
from rtstack.trials.assembly import cell_parameters

COAST_S = 0.4  # for what the impact leaves of sideways velocity, and of the posture's
GIVE_S = 0.1  # the squeeze begins with the impact, and the pads have gone in by the end of the interim mode
FADE_S = 0.1  # how quickly the squeeze is let go
# how quickly it comes: 12 Nm at once are held back by the robot's torque rate (1000 Nm/s) for 12 ms, joint by joint, so
# that the force has another direction meanwhile
SQUEEZE_S = 0.03


def plan_grab(description: CellDescription, object_name: str, plan: GrabPlan | None = None) -> PlannedMotion:
    """Return a grab of the object at its place. Raises PlanError with one line where it is not feasible, TooFast where
    a slower one may be."""
    return feasible(grab_motion, description, object_name, plan or GrabPlan())


def grab_motion(description: CellDescription, object_name: str, plan: GrabPlan) -> PlannedMotion:
    """Return a grab that is not checked. Raises PlanError with one line where there is no such motion."""
    if len(description.arms) < 2:
        raise PlanError(
            f"a grab takes two arms, and the cell {description.name} has the {description.sides[0]} one alone: plan a "
            "hit-and-push (--motion hit-and-push), or give a cell's file of two"
        )
    control = cell_parameters(description).control
    thing = object_named(description, object_name)
    description = description.about(object_name)
    check_place(description, object_name, plan.height)
    period_s, top = control.period_s, description.table.top_z
    place = np.array([0.0, 0.0, top + thing.size[2] / 2])
    approaches, rotations, inward = [], np.empty((2, 3, 3)), np.empty(2)
    for arm, mounting in enumerate(description.arms):
        start, rotation = end_effector_pose(ArmModel(mounting, description.pad), np.array(mounting.home))
        inward[arm] = -np.sign(start[1])
        turning = turn_to_object(rotation, float(inward[arm]))
        rotations[arm] = Rotation.from_rotvec(turning).as_matrix() @ rotation
        contact = place + (0.0, -inward[arm] * thing.size[1] / 2, plan.height)
        velocity = np.array([0.0, inward[arm] * plan.speed, plan.rise])
        xi = mounting.home[control.posture_joint]
        approaches.append(Approach(start, contact, velocity, xi, xi - inward[arm] * plan.posture, turning))
    touch = common_touch_s(approaches, plan.rest_s, plan.steady_s, period_s)
    ante = tuple(approach.path(touch, plan.steady_s) for approach in approaches)
    meeting = np.array(
        [points_along(path, R, np.array([touch]), period_s)[0][0] for path, R in zip(ante, rotations, strict=True)]
    )
    friction = description.contact_friction
    try:
        impact = grab_impact(
            description, object_name, meeting, friction.pad, friction.table, plan.inertia, kind=plan.map
        )
    except SceneError as error:
        raise PlanError(f"{error}; plan another height or posture") from None
    slowing = plan.compensate * _slowing(description, meeting, thing.mass)
    lower = touch + plan.lift_s + plan.carry_s
    timing = Timing(touch, lower + plan.lower_s, lower + plan.lower_s + plan.release_s + plan.rest_s)
    post = tuple(
        _post_path(plan, approach, impact.twist[arm], float(impact.dxi[arm]), float(inward[arm]), timing, slowing)
        for arm, approach in enumerate(approaches)
    )

    def forces(t_s: Array, acceleration: Array) -> Array:
        grip = np.clip(1.0 - (t_s - timing.release_s) / FADE_S, 0.0, 1.0)[:, None]
        share = plan.compensate * thing.mass / 2 * (acceleration.mean(axis=0) + (0.0, 0.0, GRAVITY))
        squeeze = plan.squeeze * inward[:, None, None] * np.array([0.0, 1.0, 0.0])
        tightening = np.clip((t_s - timing.touch_s) / SQUEEZE_S, 0.0, 1.0)[:, None]
        return grip * share + tightening * grip * squeeze

    return assemble(
        description, plan, object_name, impact.map, ante=(ante[0], ante[1]), post=(post[0], post[1]), timing=timing,
        forces=forces, rotations=rotations, object_start=place,
    )  # fmt: skip


def _slowing(description: CellDescription, meeting: NDArray, mass: float) -> float:
    """Return by how much its weight slows an object of this mass, kg, between pads that nothing drives, m/s^2: m g / (m
    + Lambda_zz of both arms), with (27). meeting (2,): points of POINT in which the pads meet it."""
    carried = mass
    for mounting, point in zip(description.arms, meeting, strict=True):
        model = ArmModel(mounting, description.pad)
        _, _, J = joint_state_near(model, np.array(mounting.home), point)
        carried += np.linalg.inv(J[:6] @ np.linalg.solve(arm_inertia(model), J[:6].T))[2, 2]
    return mass * GRAVITY / carried


def _rise(plan: GrabPlan, touch_s: float, z: float, vz: float, slowing: float) -> list[ViaPoint]:
    """Return the via points of what follows the impact upwards, vz m/s after it as the map says."""
    scaled, steady_s = plan.post_impact_scale * vz, plan.steady_s
    # a third of the speed is left, to lift on with; the same for all scales from 0.8 on, and never none
    gone = min(2.0 / 3.0 * vz, 5.0 / 6.0 * scaled)
    free_s = min(plan.momentum_s, gone / slowing - steady_s / 2.0) if slowing else 0.0
    if not free_s > 0.0:
        return [ViaPoint(touch_s, z, scaled), ViaPoint(touch_s + steady_s, z + scaled * steady_s, scaled)]
    risen, v = z + scaled * free_s - slowing * free_s**2 / 2.0, scaled - slowing * free_s
    eased_s = touch_s + free_s + steady_s  # when nothing slows any more
    return [
        ViaPoint(touch_s, z, scaled, -slowing),
        ViaPoint(touch_s + free_s, risen, v, -slowing),
        ViaPoint(eased_s, risen + v * steady_s - slowing * steady_s**2 / 3.0, v - slowing * steady_s / 2.0),
    ]


def _post_path(
    plan: GrabPlan, approach: Approach, after: Array, dxi: float, inward: float, timing: Timing, slowing: float
) -> ArmPath:
    """Return one arm's path from the nominal impact on to the end: with which velocity (6,) and dxi as the map says."""
    touch, release = timing.touch_s, timing.release_s
    velocity, dxi = plan.post_impact_scale * after, plan.post_impact_scale * dxi
    (x, y, z), (vx, vy, vz) = approach.contact.tolist(), velocity[:3].tolist()
    if not vz > 0.0:
        raise PlanError(f"after the impact the object does not rise ({vz:.3f} m/s): plan a greater --rise")
    if not plan.lift_s > max(COAST_S, plan.momentum_s + plan.steady_s):
        raise PlanError(
            f"lift_s {plan.lift_s:g} s: the lift goes on for longer than what the impact leaves of sideways velocity "
            f"takes to come to rest, {COAST_S:g} s, and than momentum_s and steady_s, "
            f"{plan.momentum_s + plan.steady_s:g} s: plan a slower one"
        )
    up = touch + plan.lift_s
    lower = up + plan.carry_s
    along_x, along_y = coast(touch, x, vx, COAST_S), coast(touch, y, vy, COAST_S)
    x_held, y_held = along_x[-1].position, along_y[-1].position + inward * plan.give * plan.squeeze
    held = touch + (GIVE_S if plan.give else COAST_S)
    back = ViaPoint(release + plan.release_s, y - inward * plan.retreat)
    lifted, carried = ViaPoint(up, z + plan.lift), ViaPoint(lower, z + plan.lift)
    return ArmPath(
        x=[*along_x, ViaPoint(up, x_held), ViaPoint(lower, x_held + plan.carry)],
        y=[along_y[0], ViaPoint(held, y_held), ViaPoint(release, y_held), back],
        z=[*_rise(plan, touch, z, float(after[2]), slowing), lifted, carried, ViaPoint(release, z)],
        xi=coast(touch, approach.xi_contact, dxi, COAST_S),
        # pads and object pitch together, as the map says; a reference that did not would take that momentum from the
        # lift. They are level again when it ends
        turn=[ViaPoint(touch, 0.0, 1.0), ViaPoint(up, 0.0)],
        turning=velocity[3:] * (plan.map is MapKind.CONVERGED),
    )
