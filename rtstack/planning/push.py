"""A single-arm hit-and-push, planned: an arm hits the object and pushes it over the table, away from itself.

Of two arms the left one pushes, and the right one goes up, out of the way.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hal.base.arrays import Array
from rtstack.impact_map import ImpactMap, SceneError, impact_map
from rtstack.impact_map.grab import grab_scene, joint_state
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.planning.feasibility import GRAVITY, check_place, feasible, object_named
from rtstack.planning.path import Approach, ArmPath, coast, common_touch_s, points_along
from rtstack.planning.planned import PlannedMotion, Timing, assemble
from rtstack.planning.request import PlanError, PushPlan
from rtstack.references.demonstration import end_effector_pose, turn_to_object
from rtstack.references.quintic import ViaPoint
from rtstack.trials.assembly import cell_parameters

COAST_S = 0.4
GIVING_WAY_S = 1.2
STILL_M_S = 1e-3  # slower than this the object is at rest, and friction has no direction


def plan_push(description: CellDescription, object_name: str, plan: PushPlan | None = None) -> PlannedMotion:
    """Return a hit-and-push of the object at its place. Raises PlanError with one line where it is not feasible,
    TooFast where a slower one may be."""
    return feasible(push_motion, description, object_name, plan or PushPlan())


def push_motion(description: CellDescription, object_name: str, plan: PushPlan) -> PlannedMotion:
    """Return a hit-and-push that is not checked. Raises PlanError with one line where there is no such motion."""
    control = cell_parameters(description).control
    thing = object_named(description, object_name)
    description = description.about(object_name)
    check_place(description, object_name, plan.height)
    period_s, top, joint = control.period_s, description.table.top_z, control.posture_joint
    place = np.array([0.0, 0.0, top + thing.size[2] / 2])
    poses = [
        end_effector_pose(ArmModel(mounting, description.pad), np.array(mounting.home)) for mounting in description.arms
    ]
    side, mounting = description.sides[0], description.arms[0]
    start, rotation = poses[0]
    inward = -float(np.sign(start[1]))
    turning = turn_to_object(rotation, inward)
    rotation = Rotation.from_rotvec(turning).as_matrix() @ rotation
    xi = mounting.home[joint]
    contact = place + (0.0, -inward * thing.size[1] / 2, plan.height)
    velocity = np.array([0.0, inward * plan.speed, 0.0])
    approach = Approach(start, contact, velocity, xi, xi - inward * plan.posture, turning)
    touch = max(common_touch_s([approach], plan.rest_s, plan.steady_s, period_s), GIVING_WAY_S)
    ante = approach.path(touch, plan.steady_s)
    meeting = points_along(ante, rotation, np.array([touch]), period_s)[0][0]
    impact = _push_impact(description, object_name, meeting, plan)
    velocity = plan.post_impact_scale * impact.twist(side, impact.of(plan.map))[:3]
    dxi = plan.post_impact_scale * float(impact.velocity(side, impact.of(plan.map))[joint])
    table = description.contact_friction.table
    gives = plan.give * table * thing.mass * GRAVITY
    post, release = _post_path(plan, approach, velocity, dxi, inward, touch, gives)
    timing = Timing(touch, release, release + plan.release_s + plan.rest_s)
    aside = [
        _aside(place, other.home[joint], plan.way_up)
        for (place, _), other in zip(poses[1:], description.arms[1:], strict=True)
    ]

    def forces(t_s: Array, acceleration: Array) -> Array:
        force = np.zeros((len(poses), len(t_s), 3))
        pushing = (t_s < timing.release_s) * float(plan.compensate)
        slides = points_along(post, rotation, t_s, period_s)[0]["twist"][:, :2]
        # the table holds the object back against its velocity, which the impact has turned aside
        along = slides / np.maximum(np.linalg.norm(slides, axis=1), STILL_M_S)[:, None]
        resistance = table * thing.mass * GRAVITY * along
        force[0, :, :2] = (thing.mass * acceleration[0, :, :2] + resistance) * pushing[:, None]
        return force

    return assemble(
        description, plan, object_name, impact, ante=(ante, *aside), post=(post, *aside), timing=timing, forces=forces,
        rotations=np.array([rotation, *(other for _, other in poses[1:])]), object_start=place,
    )  # fmt: skip


def _push_impact(description: CellDescription, object_name: str, meeting: NDArray, plan: PushPlan) -> ImpactMap:
    """Return the map of the first arm at the object on the table; the other one, if any, touches nothing."""
    side, mounting, friction = description.sides[0], description.arms[0], description.contact_friction
    try:
        q, dq = joint_state(mounting, description.pad, meeting)
        scene = grab_scene(description, object_name, q[None], dq[None], friction.pad, friction.table, plan.inertia)
        return impact_map(scene)
    except SceneError as error:
        raise PlanError(f"{side} arm: {error}; plan another height or posture") from None


def _post_path(
    plan: PushPlan, approach: Approach, velocity: Array, dxi: float, inward: float, touch: float, gives: float
) -> tuple[ArmPath, float]:
    """Return the pushing arm's path from the nominal impact on, and when it lets go of the object, s. gives: how far
    the pad goes into its silicone to push the object over the table, m."""
    (x, y, z), (vx, vy, vz) = approach.contact.tolist(), velocity.tolist()
    v = inward * vy
    slowing = plan.travel - v * plan.steady_s
    if not (v > 0.0 and slowing > 0.0):
        raise PlanError(f"after the impact the object goes at {v:.3f} m/s: plan a longer travel or a lower speed")
    steady = touch + plan.steady_s
    release = steady + 2.0 * slowing / v
    end = y + inward * (plan.travel + gives)
    path = ArmPath(
        x=coast(touch, x, vx, COAST_S),
        y=[
            ViaPoint(touch, y, vy),
            ViaPoint(steady, y + vy * plan.steady_s + inward * gives, vy),
            ViaPoint(release, end),
            ViaPoint(release + plan.release_s, end - inward * plan.retreat),
        ],
        z=coast(touch, z, vz, COAST_S),
        xi=coast(touch, approach.xi_contact, dxi, COAST_S),
    )
    return path, release


def _aside(start: Array, xi: float, way_up: float) -> ArmPath:
    """Return the other arm's path: straight up, out of the object's way."""
    x, y, z, posture = (ViaPoint(0.0, value) for value in (*start.tolist(), xi))
    return ArmPath([x], [y], [z, ViaPoint(GIVING_WAY_S, z.position + way_up)], [posture])
