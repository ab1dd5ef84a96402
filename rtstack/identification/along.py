"""What is left of friction and gravity compensation along one reference: (30)-(31) of Appendix A.

The paper averages the feedback of free runs over time, and adds it to the reference as feedforward. Feedback takes
2/sqrt(k) = 0.2 s to take up what changes; what it has not taken up yet is seen as an acceleration of the error, and
counts here, too: a_fr = a_fb + d/dt (v_d - v), which feedback would have had to be for the error to stay as it is. All
that the controller follows is looked at, the six coordinates of the pad and the posture's joint.
"""

from collections.abc import Sequence

import numpy as np
from scipy.signal import savgol_filter

from hal.arrays import Array
from rtstack.control.impedance import task_inertia
from rtstack.control.tick import ArmController
from rtstack.loop.history import Columns
from rtstack.planning.free import FreeMotion

WINDOW = 101  # ticks over which it is smoothed, by cubics: friction along a path changes with the path
FADE_S = 0.1  # at the end of what was run
COORDINATES = 7  # of the pad, six, and the posture's joint


def residual(columns: Columns, free: FreeMotion, arms: tuple[ArmController, ArmController]) -> Array:
    """Return what feedback would have had to add in a run of a free motion, (2, end - begin, 7): m/s^2, rad/s^2.

    arms: for their models.
    """
    joint, period_s = arms[0].parameters.posture_joint, free.plan.period_s
    n = min(columns.arm.shape[1], free.plan.ticks)
    found = np.empty((2, free.end - free.begin, COORDINATES))
    for side, arm in enumerate(arms):
        samples, control, points = columns.arm[side][:n], columns.control[side][:n], free.plan.ante[side][:n]
        feedback, lag = np.empty((n, COORDINATES)), np.empty((n, COORDINATES))
        wrench = control["wrench_desired"] - control["wrench_ff"]
        for i in range(n):
            arm.sample["q"][0], arm.sample["dq"][0] = samples["q"][i], samples["dq"][i]
            arm.observe()
            work = arm.workspace[0]
            task_inertia(work)
            feedback[i, :6] = work["Lambda_inverse"] @ wrench[i]
            lag[i, :6] = control["twist_ref"][i] - work["twist"]
        feedback[:, 6] = control["beta"] - points["beta"]
        lag[:, 6] = points["dxi"] - samples["dq"][:, joint]
        taken_up: Array = np.asarray(savgol_filter(feedback, WINDOW, 3, axis=0))
        left: Array = np.asarray(savgol_filter(lag, WINDOW, 3, deriv=1, delta=period_s, axis=0))
        found[side] = (taken_up + left)[free.begin : free.end]
    return found


def average(residuals: Sequence[Array], fade_s: float, period_s: float) -> Array:
    """Return (31), the mean over runs of residuals (2, n, 7), which ends within the last fade_s, not at once."""
    mean = np.mean(residuals, axis=0)
    n = mean.shape[1]
    fade = np.clip((n - np.arange(n)) * period_s / fade_s, 0.0, 1.0) if fade_s > 0.0 else np.ones(n)
    return mean * fade[None, :, None]
