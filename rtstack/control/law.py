"""The compiled part of an arm's tick: observe what is, then find the torque for what is wanted."""

import math

from hal.compilation import compiled
from rtstack.control.dense import cholesky, solve_lower, solve_lower_transposed
from rtstack.control.detector import impact_now
from rtstack.control.friction import friction_torque
from rtstack.control.impedance import desired_posture, desired_wrench, quadratic_cost, task_inertia
from rtstack.control.kinematics import end_effector
from rtstack.control.limits import acceleration_bounds, torque_bounds
from rtstack.control.observer import momentum_residual
from rtstack.samples import QpStatus

UNCONSTRAINED = int(QpStatus.UNCONSTRAINED)


@compiled
def observe(samples, workspaces, controls, model, parameters, memory):
    """Take the state in samples[0] and the model at it; return whether this arm was hit in this tick.

    model: ModelArrays; parameters (1,) of OBSERVER_PARAMETERS; memory: DetectorMemory.
    """
    sample = samples[0]
    work = workspaces[0]
    control = controls[0]
    p = parameters[0]
    end_effector(work, model.J0, model.dJ0, model.R7, model.p7, p.face, p.R_joint_ee, sample.dq)
    for i in range(7):
        coriolis = 0.0
        for j in range(7):
            coriolis += model.C[i, j] * sample.dq[j]
            work.M[i, j] = model.M[i, j] + p.B_theta[i] if i == j else model.M[i, j]
        work.coriolis[i] = coriolis
        work.gravity[i] = model.g[i]
    friction_torque(sample.dq, p.p1, p.p2, p.p3, p.friction_scale, work.friction)
    for i in range(7):
        work.friction[i] += p.gravity_share[i] * model.g[i]
    momentum_residual(work, model.M, model.C, sample.tau_J, sample.dq, p.observer_gain_hz, p.period_s, control)
    for i in range(3):
        # O_F_ext_hat_K is what the robot does to its environment; the detector wants the opposite
        work.force_world[i] = -(
            p.R_world_base[i, 0] * sample.O_F_ext_hat_K[0]
            + p.R_world_base[i, 1] * sample.O_F_ext_hat_K[1]
            + p.R_world_base[i, 2] * sample.O_F_ext_hat_K[2]
        )
    return impact_now(
        work.force_world, work.twist, memory, p.force_low_n, p.force_high_n, p.velocity_m_s, p.tare_n,
        p.largest_tare_n,
    )  # fmt: skip


@compiled
def torque(workspaces, samples, limits):
    """tau = M ddq + C dq + friction (4), gravity excluded, at most tau_step Nm away from the last applied torque.

    limits (1,) of CONTROL_LIMITS.
    """
    work = workspaces[0]
    out = samples[0].tau_desired
    tau_step = limits[0].tau_step
    for i in range(7):
        tau = work.coriolis[i] + work.friction[i]
        for j in range(7):
            tau += work.M[i, j] * work.ddq[j]
        last = work.tau_previous[i]
        out[i] = min(max(tau, last - tau_step), last + tau_step)


@compiled
def remember_torque(applied, previous):
    """Write the torque (7,) that was let through, Nm, to where the next one starts from."""
    for i in range(7):
        previous[i] = applied[i]


@compiled
def external_acceleration(work, control):
    """Write what the environment's torque accelerates the joints with to work.seven, rad/s^2: -M^-1 momentum_residual.

    work.factor: of M, as `task_inertia` has left it.
    """
    for i in range(7):
        work.seven[i] = -control.momentum_residual[i]
    solve_lower(work.factor, 7, work.seven)
    solve_lower_transposed(work.factor, 7, work.seven)


@compiled
def pose_problem(
    samples, workspaces, setpoints, controls, joint, weight_impedance, weight_posture, regularisation, limits,
):  # fmt: skip
    """Write the QP of this tick. Where no limit is active its minimiser is the solution: True, tau_desired is out."""
    sample = samples[0]
    work = workspaces[0]
    control = controls[0]
    task_inertia(work)
    desired_wrench(work, setpoints[0], control)
    desired_posture(sample.q, sample.dq, setpoints[0], control, joint)
    quadratic_cost(work, control, joint, weight_impedance, weight_posture, regularisation)
    external_acceleration(work, control)
    acceleration_bounds(sample.q, sample.dq, work.seven, limits[0], work.lower, work.upper)
    torque_bounds(work, limits[0])
    if not cholesky(work.H, 7, work.factor):
        return False
    for i in range(7):
        work.ddq[i] = -work.gradient[i]
    solve_lower(work.factor, 7, work.ddq)
    solve_lower_transposed(work.factor, 7, work.ddq)
    for i in range(7):
        if not (work.lower[i] <= work.ddq[i] <= work.upper[i]):
            return False
        tau = 0.0
        for j in range(7):
            tau += work.M[i, j] * work.ddq[j]
        if not (work.tau_lower[i] <= tau <= work.tau_upper[i]):
            return False
    torque(workspaces, samples, limits)
    control.qp_status = UNCONSTRAINED
    control.qp_iterations = 0
    return True


@compiled
def force_norm(left, right):
    """(33): the norm of both arms' desired wrenches in one vector of twelve. Written to both controls."""
    square = 0.0
    for i in range(6):
        square += left[0].wrench_desired[i] ** 2 + right[0].wrench_desired[i] ** 2
    norm = math.sqrt(square)
    left[0].force_norm = norm
    right[0].force_norm = norm
