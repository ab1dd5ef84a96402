"""Joint limits of the QP: position (12), velocity (13) and torque (14), as bounds of ddq and of M ddq + h."""

import math

from hal.compilation import compiled


@compiled
def acceleration_bounds(q, dq, push, limits, lower, upper):
    """Write the bounds of ddq, (7,), rad/s^2. limits: a record of CONTROL_LIMITS (rtstack.safety.limits).

    (13) is the position-dependent velocity limit of the arm, which falls to zero before the position limit: it keeps
    (12) too, by braking. push (7,): rad/s^2, what external torques accelerate the joints with; where it drives a joint
    towards a line as much more is braked, up to `push_max` and to what the other line allows.
    """
    for i in range(7):
        most = limits.push_max[i]
        high = _largest(limits.q_upper[i] - q[i], dq[i], limits, i)
        low = -_largest(q[i] - limits.q_lower[i], -dq[i], limits, i)
        upper[i] = max(high - min(max(push[i], 0.0), most), low)
        lower[i] = min(low - max(min(push[i], 0.0), -most), high)


@compiled
def _largest(room, speed, limits, i):
    """Return the largest acceleration, rad/s^2, of joint i towards a position limit, `room` rad before it, at `speed`.

    With the velocity v(room) that is allowed: d/dt (v - speed) >= -(v - speed) / approach_s. So the distance from
    the line falls with that time constant at most, whatever the torque's rate; a joint beyond the line comes back, and
    one on it stays there. Where v is zero it goes on as its tangent: a joint that is pushed beyond is pushed back.
    Never more than `braking` is asked for: limits are kept in a soft sense, as the paper says, and the problem stays
    feasible.
    """
    offset, deceleration = limits.velocity_offset[i], limits.deceleration[i]
    slope = deceleration / offset
    allowed = slope * room - 0.5 * offset
    if allowed > 0.0:
        allowed = math.sqrt(2.0 * deceleration * room) - offset
        slope = deceleration / (allowed + offset)
    largest = (allowed - speed) / limits.approach_s - slope * speed
    # both: at full speed the position's line may be crossed within a tick, before which dq_max alone does not brake
    largest = min(largest, (limits.dq_max[i] - speed) / limits.approach_s)
    return max(largest, -limits.braking[i])


@compiled
def torque_bounds(work, limits):
    """Write the bounds of M ddq, Nm, that keep the commanded torque (M ddq + C dq + friction) within tau_max, and with
    gravity (14), as it is measured, within tau_J_max."""
    for i in range(7):
        motion, gravity = work.coriolis[i] + work.friction[i], work.gravity[i]
        most, most_measured = limits.tau_max[i], limits.tau_J_max[i]
        work.tau_upper[i] = min(most, most_measured - gravity) - motion
        work.tau_lower[i] = max(-most, -most_measured - gravity) - motion
