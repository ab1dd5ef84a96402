"""The joints' motion along a path: inverse kinematics tick by tick, and the model at each tick, in one array each."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rtstack.control.parameters import InertiaParameters
from rtstack.impact_map import SceneError
from rtstack.impact_map.grab import joint_state_near
from rtstack.model.arm_model import ArmModel
from rtstack.planning.request import PlanError

Array = NDArray[np.floating]
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


def joint_motion(model: ArmModel, start: Array, pieces: tuple[NDArray, ...], period_s: float, side: str) -> JointMotion:
    """Return the motion through pieces (n_i,) of POINT, one after the other, from a configuration near `start` (7,).

    Velocities may jump between two pieces. Raises PlanError where the arm cannot go there.
    """
    q = start.copy()
    rows: list[tuple[Array, ...]] = []
    accelerations = []
    base_world = np.linalg.inv(model.T_world_base)
    for points in pieces:
        velocities = np.empty((len(points), 7))
        for k, point in enumerate(points):
            try:
                q, dq, J = joint_state_near(model, q, point)
            except SceneError as error:
                raise PlanError(f"{side} arm: {error}: the path leaves its reach; plan a smaller motion") from None
            velocities[k] = dq
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = point["rotation"], point["position"]
            rows.append((q, dq, model.M.copy(), model.g.copy(), J[:6], base_world @ T))
            model.update(q, dq)
            rows[-1][3][:] += model.C @ dq
            q = q + dq * period_s
        accelerations.append(np.gradient(velocities, period_s, axis=0))
    q_all, dq_all, M, bias, J, T_base_ee = (np.array(column) for column in zip(*rows, strict=True))
    M[:, _LOWER[0], _LOWER[1]] = M[:, _LOWER[1], _LOWER[0]]  # crba fills the upper triangle only
    M[:, range(7), range(7)] += InertiaParameters().B_theta
    return JointMotion(q_all, dq_all, np.concatenate(accelerations), M, bias, J, T_base_ee)


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
