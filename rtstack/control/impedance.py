"""Impedance and posture tasks: (5)-(11), (22)-(25), (27)-(32) of the reference-spreading paper, as one law."""

import math

from hal.compilation import compiled
from rtstack.control.dense import cholesky, solve_lower, symmetric_eigen
from rtstack.model.rotation import log_so3, quaternion_from_rotation, transpose_multiply


@compiled
def factor_mass(work):
    """Write the lower Cholesky factor of M to work.factor."""
    cholesky(work.M, 7, work.factor)


@compiled
def task_inertia(work):
    """Lambda^-1 = J M^-1 J^T (8) and sqrt(Lambda) from its eigenvectors. work.factor: of M, see `factor_mass`."""
    L = work.factor
    X = work.rows  # rows: L^-1 J^T
    for i in range(6):
        row = X[i]
        for k in range(7):
            row[k] = work.J[i, k]
        solve_lower(L, 7, row)
    A = work.symmetric
    for i in range(6):
        for j in range(i + 1):
            s = 0.0
            for k in range(7):
                s += X[i, k] * X[j, k]
            A[i, j] = s
            A[j, i] = s
            work.Lambda_inverse[i, j] = s
            work.Lambda_inverse[j, i] = s
    V = work.vectors
    symmetric_eigen(A, V, work.turns)
    root = work.six
    for k in range(6):
        root[k] = 1.0 / math.sqrt(max(A[k, k], 1e-12))
    for i in range(6):
        for j in range(i + 1):
            s = 0.0
            for k in range(6):
                s += V[k, i] * root[k] * V[k, j]
            work.sqrt_Lambda[i, j] = s
            work.sqrt_Lambda[j, i] = s


@compiled
def impedance_feedback(work, setpoint, control):
    """Write feedforward + weight D (v_d - v) + K error; work.six holds the pose error."""
    error, root_K = work.six, work.seven
    for i in range(6):
        root_K[i] = math.sqrt(setpoint.stiffness[i])
    for i in range(6):
        damping = 0.0
        for j in range(6):
            d = work.sqrt_Lambda[i, j] * (root_K[i] + root_K[j])
            work.D[i, j] = d
            damping += d * (setpoint.twist[j] - work.twist[j])
        control.wrench_desired[i] = (
            setpoint.wrench_ff[i] + setpoint.velocity_weight * damping + setpoint.stiffness[i] * error[i]
        )


@compiled
def acceleration_feedback(work, setpoint, control):
    """Write feedforward + Lambda times the feedback of the acceleration tasks; work.six holds the pose error."""
    error, half = work.six, work.seven
    for i in range(6):
        k = setpoint.stiffness[i]
        damping = 2.0 * math.sqrt(k) * (setpoint.twist[i] - work.twist[i])
        error[i] = setpoint.velocity_weight * damping + k * error[i]
    for i in range(6):
        half[i] = 0.0
        for j in range(6):
            half[i] += work.sqrt_Lambda[i, j] * error[j]
    for i in range(6):
        force = 0.0
        for j in range(6):
            force += work.sqrt_Lambda[i, j] * half[j]
        control.wrench_desired[i] = setpoint.wrench_ff[i] + force


@compiled
def note_setpoint(setpoint, control):
    """Write what is asked for to the control record."""
    for i in range(6):
        control.wrench_ff[i] = setpoint.wrench_ff[i]
        control.twist_ref[i] = setpoint.twist[i]
    for i in range(3):
        control.pose_ref[i] = setpoint.position[i]
    quaternion_from_rotation(setpoint.rotation, control.pose_ref[3:7])


@compiled
def note_setpoints(setpoints, controls):
    """Write setpoints[0] to controls[0], for a law that does not use `desired_wrench`."""
    note_setpoint(setpoints[0], controls[0])


@compiled
def desired_wrench(work, setpoint, control):
    """(5), (22), (27): feedforward + weight D (v_d - v) + K (pose error, along the inertial axes); D from (7).

    With acceleration tasks, (15), (16), (23), (25) of the impact-map paper: feedforward + Lambda (weight 2 sqrt(k) (v_d
    - v) + k (pose error)), so that feedback accelerates each axis by itself.
    """
    relative = work.relative
    local = work.three
    error = work.six
    transpose_multiply(work.rotation, setpoint.rotation, relative)
    log_so3(relative, local)
    for i in range(3):
        error[i] = setpoint.position[i] - work.position[i]
        error[3 + i] = work.rotation[i, 0] * local[0] + work.rotation[i, 1] * local[1] + work.rotation[i, 2] * local[2]
    if setpoint.acceleration_tasks != 0:
        acceleration_feedback(work, setpoint, control)
    else:
        impedance_feedback(work, setpoint, control)
    note_setpoint(setpoint, control)


@compiled
def desired_posture(q, dq, setpoint, control, joint):
    """(10), (24), (31): beta = beta_ff + 2 sqrt(k) weight (dxi_d - dxi) + k (xi_d - xi)."""
    k = setpoint.posture_gain
    control.beta = (
        setpoint.beta
        + 2.0 * math.sqrt(k) * setpoint.velocity_weight * (setpoint.dxi - dq[joint])
        + k * (setpoint.xi - q[joint])
    )


@compiled
def impedance_target(workspaces, setpoints, controls, target):
    """Write Lambda^-1 f - dJ dq (6,), m/s^2 and rad/s^2: the acceleration of the end effector that (15) asks for."""
    work, control = workspaces[0], controls[0]
    task_inertia(work)
    desired_wrench(work, setpoints[0], control)
    for i in range(6):
        s = -work.dJdq[i]
        for j in range(6):
            s += work.Lambda_inverse[i, j] * control.wrench_desired[j]
        target[i] = s


@compiled
def posture_target(samples, setpoints, controls, joint, target):
    """Write beta, rad/s^2, of (10) to target (1,)."""
    desired_posture(samples[0].q, samples[0].dq, setpoints[0], controls[0], joint)
    target[0] = controls[0].beta
