"""The limits of the QP as objects: (12)-(14) of the reference-spreading paper, and the base of limits of your own.

A limit bounds rows of the joint acceleration: lower <= jacobian ddq <= upper, or ddq itself. It is updated in each
tick, after the observation. The judge comes after the QP, whatever its limits are.
"""

import math
from collections.abc import Sequence

import numpy as np

from hal.base.arrays import Array
from hal.compilation import Step, compiled
from rtstack.control.controller import ObservedArm
from rtstack.control.dense import solve_lower, solve_lower_transposed


class Limit:
    """Bounds of rows of the joint acceleration ddq (7,), rad/s^2: lower <= jacobian ddq <= upper.

    A subclass writes `jacobian`, `lower` and `upper` in `update`, or gives compiled `steps` that do. Both run in the
    tick: they keep no memory, wait for nothing and raise nothing. Keep the bounds apart, lower below upper, and within
    what the joints can do: a problem without a solution stops the arms.

    Attributes:
        jacobian: (rows, 7).
        lower, upper: (rows,), in the jacobian's unit times rad/s^2. At first unbounded.
        steps: compiled functions, each with its arguments, in the place of `update`; none: `update` is called.
    """

    steps: Sequence[Step] = ()

    def __init__(self, rows: int) -> None:
        """Begin without bounds. Raises ValueError for no rows.

        Args:
            rows: 1 or more.
        """
        if rows < 1:
            raise ValueError(f"a limit has 1 row or more, not {rows}")
        self.jacobian: Array = np.zeros((rows, 7))
        self.lower: Array = np.full(rows, -math.inf)
        self.upper: Array = np.full(rows, math.inf)

    def update(self) -> None:
        """Write jacobian and bounds for the arm as it was just observed."""


class JointLimit(Limit):
    """Bounds of ddq itself: lower and upper (7,), rad/s^2. The jacobian is the identity, and is not read."""

    def __init__(self) -> None:
        super().__init__(7)
        self.jacobian[:] = np.eye(7)


@compiled
def external_acceleration(work, control):
    """Write to work.seven, rad/s^2, what the environment's torque accelerates the joints with: -M^-1 momentum_residual.

    work.factor: of M, as `factor_mass` has left it.
    """
    for i in range(7):
        work.seven[i] = -control.momentum_residual[i]
    solve_lower(work.factor, 7, work.seven)
    solve_lower_transposed(work.factor, 7, work.seven)


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
    With the velocity v(room) that is allowed: d/dt (v - speed) >= -(v - speed) / approach_s. So the distance from the
    line falls with that time constant at most, whatever the torque's rate. Where v is zero it goes on as its tangent: a
    joint that is pushed beyond is pushed back. Never more than `braking` is asked for: limits are kept in a soft sense,
    as the paper says, and the problem stays feasible."""
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


@compiled
def acceleration_limit(samples, workspaces, controls, limits):
    """Write the bounds of an AccelerationLimit."""
    work, sample = workspaces[0], samples[0]
    external_acceleration(work, controls[0])
    acceleration_bounds(sample.q, sample.dq, work.seven, limits[0], work.lower, work.upper)


class AccelerationLimit(JointLimit):
    """(12) and (13): joint positions and velocities, as bounds of ddq; see `acceleration_bounds`."""

    def __init__(self, arm: ObservedArm) -> None:
        super().__init__()
        self.lower, self.upper = arm.workspace[0]["lower"], arm.workspace[0]["upper"]
        self.steps = ((acceleration_limit, (arm.sample, arm.workspace, arm.control, arm.limits)),)


@compiled
def torque_limit(workspaces, limits):
    """Write the bounds of a TorqueLimit."""
    torque_bounds(workspaces[0], limits[0])


class TorqueLimit(Limit):
    """(14): the torque that is commanded, and with gravity the one that is measured, as bounds of M ddq, Nm."""

    def __init__(self, arm: ObservedArm) -> None:
        super().__init__(7)
        work = arm.workspace[0]
        self.jacobian, self.lower, self.upper = work["M"], work["tau_lower"], work["tau_upper"]
        self.steps = ((torque_limit, (arm.workspace, arm.limits)),)


def paper_limits(arm: ObservedArm) -> list[Limit]:
    """Return the limits of the paper's QP, (12)-(14), for an arm."""
    return [AccelerationLimit(arm), TorqueLimit(arm)]
