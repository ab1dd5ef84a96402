"""Compiled kinematics of the nominal arm: pose and Jacobian of the pad's face, and the wrench estimate."""

from math import cos, sin, sqrt

import numpy as np

from hal.compilation import compiled
from sim_robot.arm_description import JOINTS

# scratch of one arm: nothing is allocated while it runs
KINEMATICS_RECORD = np.dtype(
    [
        ("T_parent_joint", "f8", (JOINTS, 4, 4)),
        ("joint_T_face", "f8", (4, 4)),  # the end effector's frame in that of joint 7
        ("T", "f8", (4, 4)),  # T_O_EE, row-major
        ("R", "f8", (JOINTS, 3, 3)),  # of the links that the joints move
        ("axes", "f8", (JOINTS, 3)),
        ("origins", "f8", (JOINTS, 3)),
        ("J", "f8", (6, JOINTS)),  # linear, angular velocity of the pad's face along the base's axes
        ("JJ", "f8", (6, 6)),
        ("factor", "f8", (6, 6)),
        ("wrench", "f8", 6),
    ]
)


@compiled
def forward_kinematics(kinematics, q):
    """Set T and J of one record of KINEMATICS_RECORD for joint positions `q` (7,), rad."""
    T, axes, origins = kinematics.T, kinematics.axes, kinematics.origins
    for r in range(3):
        for c in range(4):
            T[r, c] = 1.0 if r == c else 0.0
    for j in range(JOINTS):
        P = kinematics.T_parent_joint[j]
        cq, sq = cos(q[j]), sin(q[j])
        for r in range(3):
            a, b, c = T[r, 0], T[r, 1], T[r, 2]
            x = a * P[0, 0] + b * P[1, 0] + c * P[2, 0]
            y = a * P[0, 1] + b * P[1, 1] + c * P[2, 1]
            z = a * P[0, 2] + b * P[1, 2] + c * P[2, 2]
            T[r, 3] += a * P[0, 3] + b * P[1, 3] + c * P[2, 3]
            T[r, 0], T[r, 1], T[r, 2] = x * cq + y * sq, y * cq - x * sq, z
            axes[j, r], origins[j, r] = z, T[r, 3]
            kinematics.R[j, r, 0], kinematics.R[j, r, 1], kinematics.R[j, r, 2] = T[r, 0], T[r, 1], z
    F = kinematics.joint_T_face
    for r in range(3):
        a, b, c = T[r, 0], T[r, 1], T[r, 2]
        T[r, 3] += a * F[0, 3] + b * F[1, 3] + c * F[2, 3]
        for k in range(3):
            T[r, k] = a * F[0, k] + b * F[1, k] + c * F[2, k]
    J = kinematics.J
    for j in range(JOINTS):
        ax, ay, az = axes[j, 0], axes[j, 1], axes[j, 2]
        rx, ry, rz = T[0, 3] - origins[j, 0], T[1, 3] - origins[j, 1], T[2, 3] - origins[j, 2]
        J[0, j], J[1, j], J[2, j] = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
        J[3, j], J[4, j], J[5, j] = ax, ay, az


@compiled
def gram(J, JJ):
    """Set the lower part of JJ (6, 6) to J J^T, J (6, 7)."""
    for i in range(6):
        for k in range(i + 1):
            total = 0.0
            for j in range(JOINTS):
                total += J[i, j] * J[k, j]
            JJ[i, k] = total


@compiled
def cholesky(A, shift, L):
    """Factor A + shift I = L L^T, 6 x 6, into the lower part of L; False where not positive definite."""
    for i in range(6):
        for j in range(i + 1):
            total = A[i, j] + (shift if i == j else 0.0)
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                if total <= 0.0:
                    return False
                L[i, i] = sqrt(total)
            else:
                L[i, j] = total / L[j, j]
    return True


@compiled
def solve(L, x):
    """Replace x (6,) by the solution y of L L^T y = x, with the factor of `cholesky`."""
    for i in range(6):
        total = x[i]
        for k in range(i):
            total -= L[i, k] * x[k]
        x[i] = total / L[i, i]
    for i in range(5, -1, -1):
        total = x[i]
        for k in range(i + 1, 6):
            total -= L[k, i] * x[k]
        x[i] = total / L[i, i]


@compiled
def estimate_wrench(kinematics, tau, smallest_singular_value, damping):
    """Set `wrench` to the damped least-squares solution of J^T F = tau, force first, about the pad's face.

    (J J^T + damping^2 I) F = J tau. Zero where J has a singular value below `smallest_singular_value`: then
    J J^T - s^2 I is not positive definite, which a factorisation tells.
    """
    J, JJ, L, F = kinematics.J, kinematics.JJ, kinematics.factor, kinematics.wrench
    F[:] = 0.0
    gram(J, JJ)
    smallest = smallest_singular_value * smallest_singular_value
    if not cholesky(JJ, -smallest, L) or not cholesky(JJ, damping * damping, L):
        return
    for i in range(6):
        for j in range(JOINTS):
            F[i] += J[i, j] * tau[j]
    solve(L, F)
