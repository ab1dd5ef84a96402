"""A dual-arm grab, planned: approach, impact, lift, carry, put down, release."""

import numpy as np
from numpy.typing import NDArray

from rtstack.control.parameters import ControlParameters
from rtstack.impact_map import SceneError
from rtstack.impact_map.grab import grab_impact
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import CellDescription
from rtstack.planning.feasibility import GRAVITY, check_impact, check_lift, check_motion, check_place, object_named
from rtstack.planning.path import Approach, ArmPath, coast, common_touch_s, points_along
from rtstack.planning.planned import PlannedMotion, Timing, assemble
from rtstack.planning.request import GrabPlan, PlanError
from rtstack.references.demonstration import end_effector_pose
from rtstack.references.motion import Motion
from rtstack.references.quintic import ViaPoint

Array = NDArray[np.floating]
COAST_S = 0.4  # for what the impact leaves of sideways velocity, and of the posture's
FADE_S = 0.1  # how quickly the squeeze is let go


def plan_grab(
    description: CellDescription,
    object_name: str,
    plan: GrabPlan | None = None,
    control: ControlParameters | None = None,
) -> PlannedMotion:
    """Return a grab of the object at its place. Raises PlanError with one line where it is not feasible."""
    plan = plan or GrabPlan()
    control = control or ControlParameters()
    thing = object_named(description, object_name)
    check_place(description, object_name, plan.height)
    period_s, top = control.period_s, description.table.top_z
    place = np.array([0.0, 0.0, top + thing.size[2] / 2])
    approaches, rotations, inward = [], np.empty((2, 3, 3)), np.empty(2)
    for arm, mounting in enumerate((description.left, description.right)):
        start, rotations[arm] = end_effector_pose(ArmModel(mounting, description.pad), np.array(mounting.home))
        inward[arm] = -np.sign(start[1])
        contact = place + (0.0, -inward[arm] * thing.size[1] / 2, plan.height)
        velocity = np.array([0.0, inward[arm] * plan.speed, plan.rise])
        xi = mounting.home[control.posture_joint]
        approaches.append(Approach(start, contact, velocity, xi, xi - inward[arm] * plan.posture))
    touch = common_touch_s(approaches, plan.rest_s, plan.steady_s, period_s)
    ante = tuple(approach.path(touch, plan.steady_s) for approach in approaches)
    meeting = np.array(
        [points_along(path, R, np.array([touch]))[0][0] for path, R in zip(ante, rotations, strict=True)]
    )
    friction = description.contact_friction
    try:
        impact = grab_impact(description, object_name, meeting, friction.pad, friction.table, plan.inertia)
    except SceneError as error:
        raise PlanError(f"{error}; plan another height or posture") from None
    check_impact(impact.map, plan.speed)
    lower = touch + plan.lift_s + plan.carry_s
    timing = Timing(touch, lower + plan.lower_s, lower + plan.lower_s + plan.release_s + plan.rest_s)
    post = tuple(
        _post_path(plan, approach, plan.post_impact_scale * impact.twist[arm, :3],
                   plan.post_impact_scale * float(impact.dxi[arm]), float(inward[arm]), timing)
        for arm, approach in enumerate(approaches)
    )  # fmt: skip

    def forces(t_s: Array, acceleration: Array) -> tuple[Array, Array]:
        grip = np.clip(1.0 - (t_s - timing.release_s) / FADE_S, 0.0, 1.0)[:, None]
        share = plan.compensate * thing.mass / 2 * (acceleration.mean(axis=0) + (0.0, 0.0, GRAVITY))
        squeeze = plan.squeeze * inward[:, None, None] * np.array([0.0, 1.0, 0.0])
        return np.stack([grip * share] * 2), grip * squeeze

    planned = assemble(
        description, plan, Motion.GRAB, object_name, (ante[0], ante[1]), (post[0], post[1]), timing, forces, impact.map,
        rotations, place, period_s, control.posture_joint,
    )  # fmt: skip
    check_lift(planned, description.contact_friction.pad, plan.squeeze)
    check_motion(planned, description)
    return planned


def _post_path(
    plan: GrabPlan, approach: Approach, velocity: Array, dxi: float, inward: float, timing: Timing
) -> ArmPath:
    """Return one arm's path from the nominal impact on, with which velocity and dxi, to the end."""
    touch, release = timing.touch_s, timing.release_s
    (x, y, z), (vx, vy, vz) = approach.contact.tolist(), velocity.tolist()
    if not vz > 0.0:
        raise PlanError(f"after the impact the object does not rise ({vz:.3f} m/s): plan a greater --rise")
    up = touch + plan.lift_s
    lower = up + plan.carry_s
    along_x, along_y = coast(touch, x, vx, COAST_S), coast(touch, y, vy, COAST_S)
    x_held, y_held = along_x[-1].position, along_y[-1].position
    return ArmPath(
        x=[*along_x, ViaPoint(up, x_held), ViaPoint(lower, x_held + plan.carry)],
        y=[*along_y, ViaPoint(release, y_held), ViaPoint(release + plan.release_s, y - inward * plan.retreat)],
        z=[
            ViaPoint(touch, z, vz),
            ViaPoint(touch + plan.steady_s, z + vz * plan.steady_s, vz),
            ViaPoint(up, z + plan.lift),
            ViaPoint(lower, z + plan.lift),
            ViaPoint(release, z),
        ],
        xi=coast(touch, approach.xi_contact, dxi, COAST_S),
    )
