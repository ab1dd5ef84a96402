"""Generalised-momentum observer of flexible joints: driven by the measured joint torque, blind to motor friction.

r = K_O (p - int(tau_J + C^T dq - g + r) dt - p(0)) + r(0), p = M dq with the links' mass matrix: (5)-(7) of the
collision-monitoring paper. r converges to the torque that the environment exerts on the joints. The paper begins with
r(0) = 0: a robot whose gravity torque is off, or whose tau_J leaves gravity out, would begin with a false impact. So r
begins as had the arm always rested: r(0) = g - tau_J - C^T dq.
"""

from hal.compilation import compiled


@compiled
def momentum_residual(work, M, C, tau_J, dq, gain, dt, control):
    """Advance the observer. control.momentum_residual has the sign of tau_ext_hat_filtered, i.e. -r, Nm."""
    joints = dq.shape[0]
    for i in range(joints):
        p = 0.0
        for j in range(joints):
            p += M[i, j] * dq[j]
        driven = tau_J[i] - work.gravity[i]
        for j in range(joints):
            driven += C[j, i] * dq[j]
        if work.observed == 0:
            work.residual_previous[i] = -driven
            work.momentum_integral[i] = p + driven / gain
        else:
            work.momentum_integral[i] += (driven + work.residual_previous[i]) * dt
        r = gain * (p - work.momentum_integral[i])
        control.momentum_residual[i] = -r
        control.residual_rate[i] = -(r - work.residual_previous[i]) / dt
        work.residual_previous[i] = r
    work.observed = 1
