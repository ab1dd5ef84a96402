"""Generalised-momentum observer of flexible joints: driven by the measured joint torque, blind to motor friction.

r = K_O (p - int(tau_J + C^T dq - g + r) dt - p(0)) + r(0), p = M dq with the links' mass matrix: (5)-(7) of the
collision-monitoring paper. r converges to the torque that the environment exerts on the joints. The paper begins with
r(0) = 0: a robot whose gravity torque is off, or whose tau_J leaves gravity out, would begin with a false impact. So r
begins as had the arm always rested: r(0) = g - tau_J - C^T dq.
"""

import numpy as np
from numpy.typing import ArrayLike

from hal.base.arrays import Array, numbers
from hal.compilation import compiled, fields

MOST_JOINTS = 1000


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


def observer_records(joints: int) -> tuple[np.dtype, np.dtype]:
    """Return the records that `momentum_residual` takes for so many joints: its memory, and what it finds."""
    memory = [*fields("f8", "gravity momentum_integral residual_previous", joints), ("observed", "i8")]
    return np.dtype(memory), np.dtype(fields("f8", "momentum_residual residual_rate", joints))


class MomentumObserver:
    """The observer of one robot of n joints, from arrays.

    Args:
        joints: n, at least 1.
        gain_hz: K_O, 1/s: the residual follows with a time constant of 1 / K_O.
        period_s: Time between two updates, s.

    Raises:
        ValueError: A number that makes no sense, such as a gain with which it diverges.
    """

    def __init__(self, joints: int, gain_hz: float = 200.0, period_s: float = 1e-3) -> None:
        self.joints = int(numbers(joints, "joints", (), np.int64))
        self._gain, self._period = float(numbers(gain_hz, "gain_hz", ())), float(numbers(period_s, "period_s", ()))
        if not 0 < self.joints <= MOST_JOINTS:
            raise ValueError(f"joints: expected 1 to {MOST_JOINTS}, found {joints}")
        if not (self._gain > 0.0 and self._period > 0.0 and self._gain * self._period < 2.0):
            raise ValueError(f"gain_hz: expected above 0 and below 2 / period_s, found {gain_hz} at {period_s} s")
        memory, found = observer_records(self.joints)
        self._memory, self._found = np.zeros(1, memory), np.zeros(1, found)

    def update(self, M: ArrayLike, C: ArrayLike, gravity: ArrayLike, tau_J: ArrayLike, dq: ArrayLike) -> Array:
        """Take a tick and return the residual (n,) Nm, positive where the robot pushes its environment.

        Args:
            M: Mass matrix of the links (n, n) kg m^2.
            C: Coriolis matrix (n, n) with dM/dt = C + C^T, such as Pinocchio's; C dq alone does not suffice.
            gravity: Torques that hold the robot against gravity (n,) Nm.
            tau_J: Measured joint torques, with gravity (n,) Nm.
            dq: Measured joint velocities (n,) rad/s.

        Raises:
            ValueError: An array that does not fit, or is not finite; nothing of the tick was taken.
        """
        n = self.joints
        mass, coriolis = numbers(M, "M", (n, n)), numbers(C, "C", (n, n))
        held, torque, speed = numbers(gravity, "gravity", (n,)), numbers(tau_J, "tau_J", (n,)), numbers(dq, "dq", (n,))
        self._memory["gravity"][0] = held
        momentum_residual(self._memory[0], mass, coriolis, torque, speed, self._gain, self._period, self._found[0])
        return self._found["momentum_residual"][0].copy()

    @property
    def rate(self) -> Array:
        """Return the rate of the residual (n,) Nm/s."""
        return self._found["residual_rate"][0].copy()
