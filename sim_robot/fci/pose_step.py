"""Poses and steps between them, and the joints' way to a pose: the geometry of Cartesian motions. Compiled."""

from math import acos, cos, sin, sqrt

import numpy as np

from hal.compilation import compiled
from sim_robot.arm_description import JOINTS
from sim_robot.fci.robot_state import product
from sim_robot.kinematics import cholesky, forward_kinematics, gram, solve

_IK_DAMPING = 1e-4


@compiled
def sine_between(A, B, w):
    """w (3,): along the axis of the turn from A to B, as long as its angle's sine; of B A^T - A B^T."""
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        total = 0.0
        for c in range(3):
            total += B[j, c] * A[i, c] - B[i, c] * A[j, c]
        w[k] = total / 2.0


@compiled
def rotation_between(A, B, w):
    """w (3,): the rotation vector from A to B, R_B = exp(w) R_A, along the base's axes."""
    trace = 0.0
    for r in range(3):
        for c in range(3):
            trace += A[r, c] * B[r, c]
    sine_between(A, B, w)
    s = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    angle = acos(max(-1.0, min(1.0, (trace - 1.0) / 2.0))) if s > 1e-4 else s
    for k in range(3):
        w[k] *= angle / s if s > 1e-12 else 1.0


@compiled
def step_between(A, B, step):
    """step (6,): from pose A to pose B, (4, 4) each, m and rad along the base's axes."""
    rotation_between(A, B, step[3:])
    step[:3] = B[:3, 3] - A[:3, 3]


@compiled
def turn(T, w, dt):
    """Turn and move T by the twist w (6,) for dt, along the base's axes."""
    T[:3, 3] += w[:3] * dt
    x, y, z = w[3] * dt, w[4] * dt, w[5] * dt
    angle = sqrt(x * x + y * y + z * z)
    if angle < 1e-15:
        return
    x, y, z = x / angle, y / angle, z / angle
    s, c = sin(angle), 1.0 - cos(angle)
    for k in range(3):
        a, b, d = T[0, k], T[1, k], T[2, k]
        u, v, e = y * d - z * b, z * a - x * d, x * b - y * a
        along = x * a + y * b + z * d
        T[0, k] = a + s * u + c * (x * along - a)
        T[1, k] = b + s * v + c * (y * along - b)
        T[2, k] = d + s * e + c * (z * along - d)


@compiled
def norm(v, first):
    return sqrt(v[first] * v[first] + v[first + 1] * v[first + 1] + v[first + 2] * v[first + 2])


@compiled
def inverse_step(body, setting, T_goal, elbow, with_elbow, q):
    """Move q (7,) towards the pose T_goal of the end effector by one damped Newton step.

    Without an elbow the smallest motion, with one joint 3 goes where the elbow says and the others make up for it.
    """
    T, error = np.empty((4, 4)), np.empty(6)
    forward_kinematics(body, q)
    product(body.T, setting.face_T_EE, T)
    step_between(T, T_goal, error)
    # the Jacobian is that of the pad's face: move the error there
    lx, ly, lz = body.T[0, 3] - T[0, 3], body.T[1, 3] - T[1, 3], body.T[2, 3] - T[2, 3]
    error[0] += error[4] * lz - error[5] * ly
    error[1] += error[5] * lx - error[3] * lz
    error[2] += error[3] * ly - error[4] * lx
    J, step3 = body.J, elbow - q[2] if with_elbow else 0.0
    if with_elbow:
        error -= J[:, 2] * step3
        J[:, 2] = 0.0
    gram(J, body.JJ)
    if not cholesky(body.JJ, _IK_DAMPING * _IK_DAMPING, body.factor):
        return
    solve(body.factor, error)
    q[2] += step3
    for j in range(JOINTS):
        for r in range(6):
            q[j] += J[r, j] * error[r]
