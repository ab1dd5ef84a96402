"""The feedback signal (28) of a trial and its integral (29), from the trial's samples."""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from hal.base.arrays import Array
from rtstack.control.impedance import factor_mass, task_inertia
from rtstack.control.tick import ArmController
from rtstack.loop.history import Columns

BEFORE_S, AFTER_S = 0.1, 0.6  # t1 and t2 of (29), around the nominal impact
DROP_S = 0.1  # after the nominal impact, in which the pads' velocity is lowest
SWING_S = 0.25  # a period of the slowest vibration that an impact leaves here, 4 Hz: pads that tilt in their silicone


@dataclass(frozen=True, slots=True)
class Direction:
    """The pads of these arms (0 left, 1 right), averaged, along the world's axis 0 to 2, positive along `sign`."""

    arms: tuple[int, ...]
    axis: int
    sign: float


@dataclass(frozen=True, slots=True)
class FeedbackSignal:
    """Over the window of (29), (n,) each: time from the nominal impact s, the pads' velocity and its reference m/s,
    feedback m/s^2, and its integral m/s. complete: whether the trial lasted for the whole window."""

    t_s: Array
    velocity: Array
    reference: Array
    feedback: Array
    integral: Array
    complete: bool

    @property
    def net(self) -> float:
        """Return a_fb,net of (29), m/s."""
        return float(self.integral[-1])

    @property
    def swing(self) -> float:
        """Return half the range of the integral in the last SWING_S, m/s: the paper's ends without vibrations."""
        return float(np.ptp(self._last)) / 2.0

    @property
    def net_over_swing(self) -> float:
        """Return the mean of the integral over the last SWING_S, m/s: which does not depend on the phase."""
        return float(self._last.mean())

    @property
    def lowest(self) -> float:
        """Return the pads' lowest velocity in the DROP_S after the nominal impact, m/s."""
        return float(self.velocity[(self.t_s > 0.0) & (self.t_s <= DROP_S)].min(initial=np.inf))

    @property
    def _last(self) -> Array:
        return self.integral[self.t_s > self.t_s[-1] - SWING_S]


def feedback_signal(
    columns: Columns, nominal_impact_s: float, arms: tuple[ArmController, ...], direction: Direction
) -> FeedbackSignal:
    """Return the signal of a trial whose samples begin with its reference. arms: for their models.

    (28) has the feedback as an acceleration of the pad: Lambda^-1 times the controller's feedback wrench, (26),
    gamma D (v_d - v) + K (x_d - x), gamma 0 at the detected impact and 1 after the interim mode; no feedforward.
    """
    t_ns = columns.arm[0]["t_ns"]
    t_s = (t_ns - t_ns[0]) * 1e-9 - nominal_impact_s
    ticks = np.flatnonzero((t_s >= -BEFORE_S - 1e-9) & (t_s <= AFTER_S + 1e-9))
    velocity, reference, feedback = (np.zeros((len(direction.arms), len(ticks))) for _ in range(3))
    for row, side in enumerate(direction.arms):
        arm, samples, control = arms[side], columns.arm[side], columns.control[side]
        wrench = control["wrench_desired"][ticks] - control["wrench_ff"][ticks]
        for i, k in enumerate(ticks):
            work = arm.observed_at(samples["q"][k], samples["dq"][k])
            factor_mass(work)
            task_inertia(work)
            velocity[row, i] = work["twist"][direction.axis]
            feedback[row, i] = work["Lambda_inverse"][direction.axis] @ wrench[i]
        reference[row] = control["twist_ref"][ticks, direction.axis]
    v, v_d, a = (direction.sign * values.mean(axis=0) for values in (velocity, reference, feedback))
    window = t_s[ticks]
    complete = bool(len(ticks) > 1 and window[0] < -BEFORE_S + 2e-3 and window[-1] > AFTER_S - 2e-3)
    return FeedbackSignal(window, v, v_d, a, cumulative_trapezoid(a, window, initial=0), complete)
