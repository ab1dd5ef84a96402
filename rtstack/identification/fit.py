"""From the samples of sweeps to friction: what the feedback had to add, as a function of the joint's velocity.

With friction compensation off, feedback makes up for friction, (30). The paper averages it over runs, (31), as a
function of time (rtstack.papers.impact_maps.worker does so on top of this). Here it is a sigmoid of the velocity,
which serves every reference, fitted to all ticks of all runs, together with the errors of the robot's gravity
compensation, which is kept, and of the joint's inertia, which is not: they must not pass for friction.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from hal.base.arrays import Array
from rtstack.control.parameters import FrictionParameters
from rtstack.control.tick import ArmController
from rtstack.identification.sweep import Sweep
from rtstack.loop.history import Columns

WINDOW = 21  # ticks over which velocity and torque are smoothed, by cubics
EVERY = 10  # ticks: what is smoothed changes no faster
# how far inertia (of the model's) and gravity compensation may be off, standard deviations: a joint that feels no
# gravity says nothing about it
INERTIA_PRIOR, GRAVITY_PRIOR = 0.1, 0.02
PRIOR_NM = 0.05  # the torque of a tick against which these count


@dataclass(frozen=True, slots=True)
class JointSamples:
    """One joint in motion, (n,) each: velocity rad/s, acceleration rad/s^2, its inertia kg m^2, gravity torque Nm, and
    the torque that feedback added, Nm."""

    dq: Array
    ddq: Array
    inertia: Array
    gravity: Array
    feedback: Array


@dataclass(frozen=True, slots=True)
class JointFriction:
    """p1 Nm, p2 s/rad, p3 rad/s, gravity_share as in FrictionParameters; rms_nm: of what the fit left."""

    p1: float
    p2: float
    p3: float
    gravity_share: float
    rms_nm: float


def joint_samples(columns: Columns, side: int, sweep: Sweep, arm: ArmController) -> JointSamples:
    """Return what a run says about the joint that moved, of arm 0 (left) or 1 (right). arm: for its model."""
    samples = columns.arm[side]
    t_s = (samples["t_ns"] - samples["t_ns"][0]) * 1e-9
    within = (t_s >= sweep.begin_s) & (t_s < sweep.end_s)
    period_s = arm.parameters.period_s
    dq: Array = np.asarray(savgol_filter(samples["dq"], WINDOW, 3, axis=0))
    ddq: Array = np.asarray(savgol_filter(samples["dq"], WINDOW, 3, deriv=1, delta=period_s, axis=0))
    # the torque of a tick answers its state, and acts until the next one
    tau: Array = np.asarray(savgol_filter(samples["tau_applied"][:, sweep.joint], WINDOW, 3))
    ticks = np.flatnonzero(within)[::EVERY]
    inertia, gravity, feedback = (np.empty(len(ticks)) for _ in range(3))
    for i, k in enumerate(ticks):
        work = arm.observed_at(samples["q"][k], dq[k])
        row = work["M"][sweep.joint]
        inertia[i], gravity[i] = row[sweep.joint], work["gravity"][sweep.joint]
        feedback[i] = tau[k] - row @ ddq[k] - work["coriolis"][sweep.joint]
    return JointSamples(dq[ticks, sweep.joint], ddq[ticks, sweep.joint], inertia, gravity, feedback)


def fit_joint(runs: Sequence[JointSamples], first_guess: FrictionParameters, joint: int) -> JointFriction:
    """Return the friction of a joint (0 to 6) from all of its runs."""
    together = JointSamples(*(np.concatenate([getattr(run, n) for run in runs]) for n in JointSamples.__slots__))

    def left(x: Array) -> Array:
        p1, p2, p3, share, inertia = x
        model = sigmoid(together.dq, p1, p2, p3) + share * together.gravity + inertia * together.inertia * together.ddq
        priors = PRIOR_NM * np.array([share / GRAVITY_PRIOR, inertia / INERTIA_PRIOR])
        return np.concatenate([model - together.feedback, priors])

    start = [*(float(getattr(first_guess, name)[joint]) for name in ("p1", "p2", "p3")), 0.0, 0.0]
    bounds = ([0.0, 0.5, -0.3, -0.2, -1.0], [20.0, 100.0, 0.3, 0.2, 1.0])
    found = least_squares(left, start, bounds=bounds, x_scale=[1.0, 10.0, 0.05, 0.01, 0.1])
    p1, p2, p3, share, _ = (float(value) for value in found.x)
    rms = float(np.sqrt(np.mean(left(found.x)[:-2] ** 2)))
    return JointFriction(p1, p2, p3, share, rms)


def sigmoid(dq: Array, p1: float, p2: float, p3: float) -> Array:
    """Return the friction torque at dq, Nm, as rtstack.control.observation has it."""
    return p1 / (1.0 + np.exp(-p2 * (dq + p3))) - p1 / (1.0 + np.exp(-p2 * p3))
