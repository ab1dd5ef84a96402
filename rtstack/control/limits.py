"""Joint limits of the QP: position (12), velocity (13) and torque (14), as bounds of ddq and of M ddq + h."""

import math

from hal.compilation import compiled


@compiled
def acceleration_bounds(q, dq, limits_table, dt, lower, upper):
    """Write the bounds of ddq, (7,), rad/s^2.

    limits_table rows: q_lower, q_upper, dq_max, velocity_offset, deceleration, braking. The velocity limit of (13) is
    the
    FR3's position-dependent one, with which (12) can be met by braking. A bound never asks for more than `braking`:
    limits are kept in a soft sense, as the paper says, and the problem stays feasible.
    """
    for i in range(7):
        room_up = limits_table[1, i] - q[i]
        room_down = q[i] - limits_table[0, i]
        deceleration = 2.0 * limits_table[4, i]
        dq_up = math.sqrt(deceleration * max(room_up, 0.0)) - limits_table[3, i]
        dq_down = math.sqrt(deceleration * max(room_down, 0.0)) - limits_table[3, i]
        dq_up = min(limits_table[2, i], max(0.0, dq_up))
        dq_down = -min(limits_table[2, i], max(0.0, dq_down))
        high = min((dq_up - dq[i]) / dt, 2.0 * (room_up - dq[i] * dt) / (dt * dt))
        low = max((dq_down - dq[i]) / dt, -2.0 * (room_down + dq[i] * dt) / (dt * dt))
        braking = limits_table[5, i]
        upper[i] = max(high, -braking)
        lower[i] = min(low, braking)


@compiled
def torque_bounds(work, tau_max):
    """Write the bounds of M ddq: -tau_max <= M ddq + C dq + g + friction <= tau_max, Nm."""
    for i in range(7):
        bias = work.coriolis[i] + work.gravity[i] + work.friction[i]
        work.tau_upper[i] = tau_max[i] - bias
        work.tau_lower[i] = -tau_max[i] - bias
