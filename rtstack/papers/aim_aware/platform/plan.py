"""What a hit is meant to be: a motion in the vertical plane of joints 2, 4 and 6, the pad facing down."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.pad import Pad
from rtstack.control.records import POINT
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import ArmMounting
from rtstack.papers.aim_aware.planar.parameters import Task
from rtstack.papers.aim_aware.planar.plan import Meant, Reference, approach_velocity, impact_references

IN_PLANE = [1, 3, 5]  # joints 2, 4, 6 turn about the y axis while the others are straight
AXES = [0, 2, 4]  # of a twist: x, z, about y
PERIOD_S = 1e-3
ITERATIONS = 30
REACHED = 1e-10


@dataclass(frozen=True, slots=True)
class HitPlan(Meant[NDArray[np.void]]):
    """Of an arm: references (n,) of POINT."""


def plan_hit(
    mounting: ArmMounting, pad: Pad, task: Task, approach_rad: float, x_m: float, twist_post: Array
) -> HitPlan:
    """Plan to hit a horizontal platform at x_m (Section III-A). Raises ValueError for a place out of reach.

    twist_post (3,): what it leaves of the motion, x m/s, z m/s, about y rad/s.
    """
    model = ArmModel(mounting, pad)
    t_s = PERIOD_S * np.arange(round(task.duration_s / PERIOD_S))
    hit = np.array([x_m, task.surface_height_m, 0.0])
    ante, post = impact_references(task, t_s, hit, approach_velocity(task, approach_rad), twist_post)
    q_d = joints_at(model, np.array(mounting.home), hit)
    k_d = round(task.approach_s / PERIOD_S)
    ante_points, q_ante, _ = _points(model, ante, q_d, k_d, None)
    post_points, _, dq_post = _points(model, post, q_d, k_d, task.push_n)
    return HitPlan(task.approach_s, q_ante[0], q_d, ante_points, post_points, dq_post)


def joints_at(model: ArmModel, q: Array, x: Array) -> Array:
    """Return the joints (7,) near q that put the pad's face at x m, z m, pitch rad (3,). Raises ValueError."""
    q = q.copy()
    for _ in range(ITERATIONS):
        J = face_jacobian(model, q)[np.ix_(AXES, IN_PLANE)]  # x, z m/s and pitch rad/s by joints 2, 4 and 6
        T = model.R7 @ model.R_joint_ee
        position = model.p7 + model.R7 @ model.face
        pitch = np.arctan2(-T[0, 2], -T[2, 2])  # of the pad's normal, which looks down at 0
        error = x - np.array([position[0], position[2], pitch])
        if np.abs(error).max() < REACHED:
            return q
        q[IN_PLANE] += np.linalg.solve(J, error)
    raise ValueError(f"x = {x[0]:.3g} m, z = {x[1]:.3g} m is out of the arm's reach")


def face_jacobian(model: ArmModel, q: Array) -> Array:
    """Return the Jacobian (6, 7) of the pad's face, linear first; the model is at q, at rest, afterwards."""
    model.update(q, np.zeros(7))
    J = np.array(model.J0, dtype=np.float64)
    position = model.p7 + model.R7 @ model.face
    J[:3] += np.cross(J[3:].T, position).T  # from the world's origin to the face
    return J


def _points(
    model: ArmModel, reference: Reference, q_d: Array, k_d: int, push_n: float | None
) -> tuple[NDArray[np.void], Array, Array]:
    """Return the points of a reference, its joints and their velocities (n, 7); push_n: pressed down, not tracked.

    The feedforward is Lambda times the acceleration, Lambda with the motors' inertia (paper A, (8)).
    """
    x, dx, ddx = reference
    points = np.zeros(len(x), POINT)
    q, dq = np.zeros((2, len(x), 7))
    B_theta = np.diag(model.robot.B_theta)
    for way in (range(k_d, len(x)), range(k_d - 1, -1, -1)):  # outwards from the impact, whose joints are known
        near = q_d
        for k in way:
            near = q[k] = joints_at(model, near, x[k])
            J = face_jacobian(model, near)
            dq[k, IN_PLANE] = np.linalg.solve(J[np.ix_(AXES, IN_PLANE)], dx[k])
            M = model.M + B_theta
            acceleration = np.zeros(6)
            acceleration[AXES] = ddx[k]
            points["wrench_ff"][k] = np.linalg.solve(J @ np.linalg.solve(M, J.T), acceleration)
            points["rotation"][k] = model.R7 @ model.R_joint_ee
    points["position"][:, [0, 2]] = x[:, :2]
    points["twist"][:, AXES] = dx
    if push_n is not None:
        points["wrench_ff"][:, 2] -= push_n
    return points, q, dq
