"""One impact, compiled: tracking law at 1 kHz, plant, momentum observer, detection for the switch of references."""

import numpy as np
from numpy.typing import NDArray

from hal.compilation import compiled
from rtstack.control.observer import momentum_residual, observer_records
from rtstack.papers.aim_aware.planar.dynamics import absolute, advance, coriolis, inertia, tip, transmitted, weight
from rtstack.papers.aim_aware.planar.parameters import Contact, Gains, PlanarArm, Task
from rtstack.papers.aim_aware.planar.plan import Plan

# what a tick leaves: time ns; rad, rad/s; residual Nm; forces of the corners N; x m m rad; post: 1 once it was detected
TICK = np.dtype([
    ("t_ns", "i8"), ("q", "f8", 3), ("dq", "f8", 3), ("residual", "f8", 3), ("forces", "f8", 2),
    ("x", "f8", 3), ("dx", "f8", 3), ("tau_d", "f8", 3), ("post", "i8"),
])  # fmt: skip
_OBSERVER, _OBSERVED = observer_records(3)
_GAINS = np.dtype([
    ("stiffness", "f8", 3), ("damping_ratio", "f8"), ("observer_gain", "f8"), ("period_s", "f8"),
    ("substeps", "i8"), ("push_n", "f8"), ("residual_rate", "f8", 3),
])  # fmt: skip


def simulate(
    planar: PlanarArm, contact: Contact, task: Task, gains: Gains, residual_rate_nm_s: tuple[float, ...], plan: Plan,
    x_m: float, inclination_rad: float,
) -> NDArray[np.void]:  # fmt: skip
    """Return the ticks (n,) of TICK of the impact `plan` on a surface that is inclined about (x_m, surface height).

    The references switch at the first tick whose residual's rate reaches residual_rate_nm_s, as (9) has it.
    """
    arm = planar.record()
    surface = contact.surface(x_m, task.surface_height_m, inclination_rad)
    numbers = np.zeros(1, _GAINS)
    numbers["stiffness"], numbers["damping_ratio"] = gains.stiffness, gains.damping_ratio
    numbers["observer_gain"], numbers["push_n"] = gains.observer_gain_hz, task.push_n
    numbers["period_s"], numbers["substeps"] = gains.period_s, gains.substeps
    numbers["residual_rate"] = residual_rate_nm_s
    ticks = np.zeros(len(plan.dq_post), TICK)
    _run(arm, surface, numbers, plan.q_start, *plan.ante, *plan.post, ticks)
    return ticks


@compiled
def _run(arms, surfaces, numbers, q_start, x_a, dx_a, ddx_a, x_p, dx_p, ddx_p, ticks):
    arm, surface, gains = arms[0], surfaces[0], numbers[0]
    psi, dpsi, dJdq, g, tau_d, tau_J = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    J, M, M_r, C = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    state, work = np.zeros(12), np.zeros((5, 12))
    observers, observeds = np.zeros(1, _OBSERVER), np.zeros(1, _OBSERVED)
    observer, observed = observers[0], observeds[0]
    absolute(q_start, psi)
    weight(arm, psi, g)
    for j in range(3):  # at rest, the joints bent by the weight
        state[j] = q_start[j]
        state[3 + j] = q_start[j] + g[j] / arm.K[j]
    post = 0
    step_s = gains.period_s / gains.substeps
    for k in range(ticks.shape[0]):
        tick = ticks[k]
        tick.t_ns = round(k * gains.period_s * 1e9)
        for j in range(3):
            tick.q[j], tick.dq[j] = state[j], state[6 + j]
            tau_J[j] = transmitted(arm, state, j)
        absolute(tick.q, psi)
        absolute(tick.dq, dpsi)
        tip(arm, psi, dpsi, tick.x, J, dJdq)
        inertia(arm, psi, M)
        coriolis(arm, psi, dpsi, C)
        weight(arm, psi, g)
        for j in range(3):
            observer.gravity[j] = g[j]
        momentum_residual(observer, M, C, tau_J, tick.dq, gains.observer_gain, gains.period_s, observed)
        for j in range(3):
            tick.residual[j] = observed.momentum_residual[j]
            if abs(observed.residual_rate[j]) >= gains.residual_rate[j]:
                post = 1
        tick.post = post
        tick.dx[:] = J @ tick.dq
        M_r[:] = M
        for j in range(3):
            M_r[j, j] += arm.B_theta[j]
        if post == 0:
            _track(gains, M_r, C, J, dJdq, g, tick, x_a[k], dx_a[k], ddx_a[k], tau_d)
        else:
            _track(gains, M_r, C, J, dJdq, g, tick, x_p[k], dx_p[k], ddx_p[k], tau_d)
        tick.tau_d[:] = tau_d
        advance(arm, surface, state, tau_d, step_s, gains.substeps, work, tick.forces)


@compiled
def _track(gains, M_r, C, J, dJdq, g, tick, x, dx, ddx, tau_d):
    """Impedance with the reference's acceleration fed forward; after the impact y is not tracked but pressed down.

    f = Lambda (x-ddot_ref - J-dot q-dot) + D (x-dot_ref - x-dot) + K (x_ref - x), D = 2 ratio sqrt(K Lambda_ii).
    """
    Lambda = np.linalg.inv(J @ np.linalg.solve(M_r, J.T))
    f = Lambda @ (ddx - dJdq)
    for i in range(3):
        if tick.post != 0 and i == 1:
            f[i] -= gains.push_n
            continue
        damping = 2.0 * gains.damping_ratio * np.sqrt(gains.stiffness[i] * Lambda[i, i])
        f[i] += damping * (dx[i] - tick.dx[i]) + gains.stiffness[i] * (x[i] - tick.x[i])
    tau_d[:] = J.T @ f + C @ tick.dq + g
