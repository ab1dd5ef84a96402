"""A real Panda on an exciting trajectory: measured joint torques, and what the model of its arm says.

The published model (Gaz et al., RA-L 2019) is where the inertias and the friction of our description come from.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares
from scipy.signal import butter, sosfiltfilt

from hal.base.arrays import Array
from hal.robots import FER
from reality.comparison import Finding
from rtstack.identification.fit import sigmoid

PERIOD_S = 1e-3
CUTOFF_HZ = 10.0  # of the trajectory's and the torques' low-pass, forward and backward: no shift in time
MARGIN = 500  # samples at both ends of a part: what the low-pass makes of an end is left out


def compare(folder: Path) -> Finding:
    """Fit friction on the first half of the trajectory, judge on the second one: RMS of the torque by joint, Nm."""
    q, dq, ddq, tau = _trajectory(folder)
    model = pin.buildModelFromXML(FER.urdf)
    data = model.createData()
    rigid = np.array([pin.rnea(model, data, *sample) for sample in zip(q, dq, ddq, strict=True)])
    n = len(q)
    fit, judge = slice(MARGIN, n // 2), slice(n // 2 + MARGIN, n - MARGIN)
    published = np.column_stack([sigmoid(dq[:, j], *(p[j] for p in FER.friction)) for j in range(7)])
    left = tau - rigid
    fitted = np.column_stack([_fitted(dq[fit, j], left[fit, j], j)(dq[judge, j]) for j in range(7)])
    lines = {
        "rigid body": left[judge],
        "with published friction": left[judge] - published[judge],
        "with fitted friction": left[judge] - fitted,
    }
    return Finding(
        n, len(fitted), "Nm RMS", [f"joint {j}" for j in range(1, 8)],
        {name: np.sqrt(np.mean(error**2, axis=0)).tolist() for name, error in lines.items()},
        "with fitted friction", "with published friction",
        "by joint: the friction's three numbers, a viscous one, and a constant torque",
    )  # fmt: skip


def _fitted(dq: Array, left: Array, joint: int) -> Callable[[Array], Array]:
    """Return the torque, as a function of velocity, that was fitted to what the rigid model leaves."""

    def torque(x: Array, velocity: Array) -> Array:
        return sigmoid(velocity, *x[:3]) + x[3] * velocity + x[4]

    start = [*(float(p[joint]) for p in FER.friction), 0.0, 0.0]
    bounds = ([0.0, 0.5, -0.3, -5.0, -5.0], [20.0, 100.0, 0.3, 5.0, 5.0])
    x = least_squares(lambda x: torque(x, dq) - left, start, bounds=bounds).x
    return lambda velocity: torque(x, velocity)


def _trajectory(folder: Path) -> tuple[Array, Array, Array, Array]:
    """Return q, dq, ddq, tau (n, 7) at 1 kHz: the recording's own stamps are 0.7 to 9 ms apart."""
    raw = {
        name: np.loadtxt(folder / f"exciting_traj_{name}.txt") for name in ("time", "positions", "velocity", "torques")
    }
    t = np.arange(raw["time"][0], raw["time"][-1], PERIOD_S)
    sections = butter(3, CUTOFF_HZ, fs=1.0 / PERIOD_S, output="sos")
    q, dq, tau = (
        np.column_stack([sosfiltfilt(sections, np.interp(t, raw["time"], column))
                         for column in raw[name].reshape(-1, 7).T])
        for name in ("positions", "velocity", "torques")
    )  # fmt: skip
    return q, dq, np.gradient(dq, PERIOD_S, axis=0), tau
