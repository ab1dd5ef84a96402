"""The joints' motion along a path: inverse kinematics, and the model at each tick, in one array each."""

from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, interp1d

from hal.base.arrays import Array
from rtstack.impact_map import SceneError
from rtstack.impact_map.grab import joint_state_near
from rtstack.impact_map.problem import JOINTS
from rtstack.model.arm_model import ArmModel
from rtstack.planning.request import PlanError

# inverse kinematics every 10 ms: between them q is within 1e-7 rad, M and J are within 1e-4 of theirs
NODE_TICKS = 10
REPAY_TICKS = 30


@dataclass(frozen=True, slots=True)
class JointMotion:
    """One arm at n ticks: q (n, 7) rad, dq rad/s, ddq rad/s^2; M (n, 7, 7) with the reflected inertia of the torque
    loop, bias (n, 7) Nm of gravity and velocities, J (n, 6, 7) of the pad's face along the world's axes; T_base_ee
    (n, 4, 4) of the face in the arm's base."""

    q: Array
    dq: Array
    ddq: Array
    M: Array
    bias: Array
    J: Array
    T_base_ee: Array


def joint_motion(
    model: ArmModel, start: Array, pieces: tuple[NDArray, ...], period_s: float, posture_joint: int, side: str
) -> JointMotion:
    """Return the motion through pieces (n_i,) of POINT, one after the other, from a configuration near `start` (7,).
    Velocities may jump between two pieces. Raises PlanError where the arm cannot go there."""
    parts, q = [], start
    for points in pieces:
        parts.append(_piece(model, q, points, period_s, posture_joint, side))
        q = parts[-1].q[-1]
    return JointMotion(*(np.concatenate(column) for column in zip(*map(astuple, parts), strict=True)))


def _piece(model: ArmModel, q: Array, points: NDArray, period_s: float, posture_joint: int, side: str) -> JointMotion:
    """Return the motion through one piece: exact at every NODE_TICKS-th point, interpolated between them."""
    nodes = np.unique(np.append(np.arange(0, len(points), NODE_TICKS), len(points) - 1))
    rows: list[tuple[Array, ...]] = []
    for point in points[nodes]:
        try:
            q, dq, J = joint_state_near(model, q, point)
        except SceneError as error:
            raise PlanError(f"{side} arm: {error}: the path leaves its reach; plan a smaller motion") from None
        M = arm_inertia(model)
        model.update(q, dq)
        rows.append((q, dq, M, model.g + model.C @ dq, J[:6]))
        q = q + dq * NODE_TICKS * period_s
    q_nodes, dq_nodes, M, bias, J = (np.array(column) for column in zip(*rows, strict=True))
    ticks = np.arange(len(points))
    path = CubicHermiteSpline(nodes * period_s, q_nodes, dq_nodes)
    q_all, dq_all, ddq_all = (path(ticks * period_s, order) for order in range(3))
    q_all[:, posture_joint], dq_all[:, posture_joint] = points["xi"], points["dxi"]  # these are asked for exactly
    M, bias, J = (interp1d(nodes, values, axis=0)(ticks) for values in (M, bias, J))
    T_world_ee = np.zeros((len(points), 4, 4))
    T_world_ee[:, :3, :3], T_world_ee[:, :3, 3], T_world_ee[:, 3, 3] = points["rotation"], points["position"], 1.0
    return JointMotion(q_all, dq_all, ddq_all, M, bias, J, np.linalg.inv(model.T_world_base) @ T_world_ee)


def arm_inertia(model: ArmModel) -> Array:
    """Return M + B_theta (7, 7) of an arm where the model is, with the reflected inertia of the torque loop."""
    return model.M + np.diag(model.robot.B_theta)


def feedforward(motion: JointMotion, acceleration: Array, torque: Array, posture_joint: int) -> tuple[Array, Array]:
    """Return wrench_ff (n, 6) and beta (n,) of a pad that accelerates with `acceleration` (n, 7: as `points_along`)
    while the arm exerts `torque` (n, 7) Nm beside it, J^T of a force on the object: Lambda times the acceleration, and
    the force; its reaction turns the posture's joint too. (22), (26)-(27) of the impact-map paper."""
    reaction = np.linalg.solve(motion.M, torque[:, :, None])[:, :, 0]
    wanted = np.einsum("nij,nj->ni", motion.J, reaction) + acceleration[:, :6]
    inverse = motion.J @ np.linalg.solve(motion.M, motion.J.transpose(0, 2, 1))  # Lambda^-1
    return np.linalg.solve(inverse, wanted[:, :, None])[:, :, 0], acceleration[:, 6] + reaction[:, posture_joint]


def held_back(step: Array, rate: float, period_s: float) -> Array:
    """Return the impulse (7,) Nms that a torque rate, Nm/s, holds back of a torque that steps by `step` (7,) Nm."""
    largest = rate * period_s
    ticks = np.arange(1, int(np.abs(step).max() / largest) + 1)
    return np.sign(step) * np.maximum(np.abs(step) - largest * ticks[:, None], 0.0).sum(axis=0) * period_s


def repaid(impulse: Array, n: int, period_s: float) -> Array:
    """Return torques (n, 7) Nm that give an impulse (7,) Nms within REPAY_TICKS, and none after them."""
    torque = np.zeros((n, JOINTS))
    shape = np.sin(np.pi * (np.arange(REPAY_TICKS) + 0.5) / REPAY_TICKS) ** 2
    torque[:REPAY_TICKS] = np.outer(shape / (shape.sum() * period_s), impulse)[:n]
    return torque
