"""The joints' motion along a path: inverse kinematics, and the model at each tick, in one array each."""

from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, interp1d

from rtstack.control.parameters import InertiaParameters
from rtstack.impact_map import SceneError
from rtstack.impact_map.grab import joint_state_near
from rtstack.model.arm_model import ArmModel
from rtstack.planning.request import PlanError

Array = NDArray[np.floating]
# inverse kinematics every 10 ms: between them q is within 1e-7 rad, M and J are within 1e-4 of theirs
NODE_TICKS = 10
_LOWER = np.tril_indices(7, -1)


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

    Velocities may jump between two pieces. Raises PlanError where the arm cannot go there.
    """
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
        M = model.M.copy()
        model.update(q, dq)
        rows.append((q, dq, M, model.g + model.C @ dq, J[:6]))
        q = q + dq * NODE_TICKS * period_s
    q_nodes, dq_nodes, M, bias, J = (np.array(column) for column in zip(*rows, strict=True))
    M[:, _LOWER[0], _LOWER[1]] = M[:, _LOWER[1], _LOWER[0]]  # crba fills the upper triangle only
    M[:, range(7), range(7)] += InertiaParameters().B_theta
    ticks = np.arange(len(points))
    path = CubicHermiteSpline(nodes * period_s, q_nodes, dq_nodes)
    q_all, dq_all, ddq_all = (path(ticks * period_s, order) for order in range(3))
    q_all[:, posture_joint], dq_all[:, posture_joint] = points["xi"], points["dxi"]  # these are asked for exactly
    M, bias, J = (interp1d(nodes, values, axis=0)(ticks) for values in (M, bias, J))
    T_world_ee = np.zeros((len(points), 4, 4))
    T_world_ee[:, :3, :3], T_world_ee[:, :3, 3], T_world_ee[:, 3, 3] = points["rotation"], points["position"], 1.0
    return JointMotion(q_all, dq_all, ddq_all, M, bias, J, np.linalg.inv(model.T_world_base) @ T_world_ee)


def feedforward(motion: JointMotion, acceleration: Array, force: Array, posture_joint: int) -> tuple[Array, Array]:
    """Return wrench_ff (n, 6) and beta (n,) of a pad that accelerates with `acceleration` (n, 4: x, y, z, posture)
    while it exerts `force` (n, 3) N on the object: (22), (26)-(27) of the impact-map paper.

    Lambda times the acceleration, and the force; its reaction turns the posture's joint too, which beta takes along.
    """
    reaction = np.linalg.solve(motion.M, motion.J.transpose(0, 2, 1))  # M^-1 J^T
    wanted = np.zeros((len(force), 6))
    wanted[:, :3] = acceleration[:, :3]
    wrench = np.linalg.solve(motion.J @ reaction, wanted[:, :, None])[:, :, 0]
    wrench[:, :3] += force
    beta = acceleration[:, 3] + np.einsum("nk,nk->n", reaction[:, posture_joint, :3], force)
    return wrench, beta
