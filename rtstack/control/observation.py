"""The compiled part of an arm's tick beside its law: observe the state, remember the torque, the norm of all forces."""

import math

from hal.compilation import compiled
from rtstack.control.detector import impact_now
from rtstack.control.observer import momentum_residual


@compiled
def end_effector(work, J0, dJ0, R7, p7, face, R_joint_ee, dq):
    """Write position, rotation, J (6, 7), twist and dJ dq (6,) of the end effector, along the world's axes (1)-(2).

    The classical acceleration at zero ddq: a = dv0 + alpha x p + w x v, dv0 and alpha of the body's point at the
    world's origin.
    """
    for i in range(3):
        work.position[i] = p7[i] + R7[i, 0] * face[0] + R7[i, 1] * face[1] + R7[i, 2] * face[2]
        for j in range(3):
            work.rotation[i, j] = (
                R7[i, 0] * R_joint_ee[0, j] + R7[i, 1] * R_joint_ee[1, j] + R7[i, 2] * R_joint_ee[2, j]
            )
    x = work.position[0]
    y = work.position[1]
    z = work.position[2]
    for i in range(6):
        work.twist[i] = 0.0
        work.dJdq[i] = 0.0
    for k in range(7):
        wx = J0[3, k]
        wy = J0[4, k]
        wz = J0[5, k]
        work.J[0, k] = J0[0, k] + wy * z - wz * y
        work.J[1, k] = J0[1, k] + wz * x - wx * z
        work.J[2, k] = J0[2, k] + wx * y - wy * x
        work.J[3, k] = wx
        work.J[4, k] = wy
        work.J[5, k] = wz
        for i in range(6):
            work.twist[i] += work.J[i, k] * dq[k]
            work.dJdq[i] += dJ0[i, k] * dq[k]
    a = work.dJdq
    v = work.twist
    ax = a[0] + (a[4] * z - a[5] * y) + (v[4] * v[2] - v[5] * v[1])
    ay = a[1] + (a[5] * x - a[3] * z) + (v[5] * v[0] - v[3] * v[2])
    az = a[2] + (a[3] * y - a[4] * x) + (v[3] * v[1] - v[4] * v[0])
    a[0] = ax
    a[1] = ay
    a[2] = az


@compiled
def friction_torque(dq, p1, p2, p3, scale, out):
    """Write the torque (7,), Nm, that overcomes the friction at dq: it has the sign of the velocity."""
    for i in range(7):
        rest = 1.0 / (1.0 + math.exp(-p2[i] * p3[i]))
        out[i] = scale * p1[i] * (1.0 / (1.0 + math.exp(-p2[i] * (dq[i] + p3[i]))) - rest)


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
def remember_torque(applied, previous):
    """Write the torque (7,) that was let through, Nm, to where the next one starts from."""
    for i in range(7):
        previous[i] = applied[i]


@compiled
def force_norm(controls):
    """(33): the norm of all arms' desired wrenches in one vector. Written to each arm's control record."""
    square = 0.0
    for i in range(6):
        part = 0.0
        for control in controls:
            part += control[0].wrench_desired[i] ** 2
        square += part
    norm = math.sqrt(square)
    for control in controls:
        control[0].force_norm = norm
