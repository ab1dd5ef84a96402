"""What logs with contact say: how late the robot's estimate of external torques is, and how stiff a pad on an object.

The estimate is taken as the simulated robot makes it: the mean over a millisecond, a first-order low-pass, a delay. The
delay is that of the torque which the links' motion leaves unexplained; a real robot's other filters are in it. Both
pads press on one object: the squeeze is k times how far each goes in, half of what the pads come together, and a
damper's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from rtstack.identification.arm import CONTACT_N, PERIOD_S, WINDOW, rate, smooth, touches
from rtstack.identification.estimate import Estimate, curve, linear
from rtstack.model.cell_description import ArmMounting, base_frame

Array = NDArray[np.float64]

LONGEST_MS = 50.0
BLOCK = 100  # ticks that share their errors: a pad's vibration dies out in some 100 ms
AROUND = 200  # ticks before and after a contact begins or ends, in which an estimate shows how late it is
UNKNOWN = Estimate(np.zeros(1), np.full(1, np.inf))


@dataclass(frozen=True, slots=True)
class ContactLog:
    """The ARM_SAMPLE records (n,) of both arms, and of each what its inertial parameters (70,) lack in the model."""

    arms: tuple[NDArray, NDArray]
    inertial: tuple[Array, Array]


def estimate_delay(model: pin.Model, logs: Sequence[ContactLog], side: int, cutoff_hz: float) -> Estimate:
    """Return how late the estimate of an arm (0, 1) is beyond a low-pass of cutoff_hz, (1,), ms."""
    left, shown, blocks = [], [], []
    for number, log in enumerate(logs):
        records = log.arms[side]
        touched = touches(records)
        changes = np.flatnonzero(np.diff(touched.astype(np.int8)))
        near = np.zeros(len(records), dtype=bool)
        for at in changes:
            near[max(0, at - AROUND) : at + AROUND] = True
        for begin, end in _runs(near):
            if begin < WINDOW or end > len(records) - WINDOW:
                continue
            part = records[begin - WINDOW : end + WINDOW]  # smoothing is wrong at its ends
            left.append(CubicSpline(np.arange(len(part)), _unexplained(model, part, log.inertial[side])))
            shown.append(smooth(part["tau_ext_hat_filtered"])[WINDOW:-WINDOW])
            blocks.append(np.repeat(100_000 * number + np.arange(begin, end) // BLOCK, 7))
    if not left:
        return UNKNOWN

    def residual(x: Array) -> Array:
        found = []
        for unexplained, seen in zip(left, shown, strict=True):
            ticks = np.arange(len(seen) + 2 * WINDOW, dtype=float)
            off = _seen(unexplained(np.clip(ticks - x[0], 0.0, None)), cutoff_hz)[WINDOW:-WINDOW] - seen
            found.append((off - off.mean(axis=0)).reshape(-1))
        return np.concatenate(found)

    starts = np.arange(0.0, LONGEST_MS + 1.0)
    best = min(starts, key=lambda ms: float(np.sum(residual(np.array([ms])) ** 2)))
    bounds = (np.array([-2.0]), np.array([LONGEST_MS + 2.0]))
    return curve(residual, np.array([best]), bounds, np.ones(1), np.concatenate(blocks))


def contact_stiffness(
    mountings: tuple[ArmMounting, ArmMounting], logs: Sequence[ContactLog], delays_ms: tuple[float, float],
    cutoff_hz: float,
) -> Estimate:  # fmt: skip
    """Return the stiffness of a pad's face on what both pads hold, silicone and wall in series, (1,), N/m."""
    rotations = [base_frame(mounting).rotation for mounting in mountings]
    places = [base_frame(mounting).translation for mounting in mountings]
    columns, forces, blocks = [], [], []
    for number, log in enumerate(logs):
        n = min(map(len, log.arms))
        pads = [arm["O_T_EE"][:n, :3].astype(float) for arm in log.arms]
        axes = [pad[:, :, 2] @ R.T for pad, R in zip(pads, rotations, strict=True)]
        faces = [pad[:, :, 3] @ R.T + place for pad, R, place in zip(pads, rotations, places, strict=True)]
        normal = axes[0] - axes[1]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        inward = -0.5 * np.sum((faces[1] - faces[0]) * normal, axis=1)
        pushes = [np.sum(arm["O_F_ext_hat_K"][:n, :3] @ R.T * axis, axis=1)
                  for arm, R, axis in zip(log.arms, rotations, axes, strict=True)]  # fmt: skip
        held = np.all([smooth(push) > 2.0 * CONTACT_N for push in pushes], axis=0)
        delay = float(np.mean(delays_ms))
        ticks = np.arange(n, dtype=float)
        seen = [_seen(np.interp(ticks - delay, ticks, values), cutoff_hz) for values in (smooth(inward), rate(inward))]
        squeeze = smooth(0.5 * (pushes[0] + pushes[1]))
        for begin, end in _runs(held):
            if end - begin < 2 * WINDOW:
                continue
            part = slice(begin, end)
            columns.append(np.column_stack([values[part] - values[part].mean() for values in seen]))
            forces.append(squeeze[part] - squeeze[part].mean())
            blocks.append(100_000 * number + np.arange(begin, end) // BLOCK)
    if not columns:
        return UNKNOWN
    found = linear(np.concatenate(columns), np.concatenate(forces), np.concatenate(blocks))
    return Estimate(found.value[:1], found.half_width[:1])


def _unexplained(model: pin.Model, records: NDArray, inertial: Array) -> Array:
    """Return the torque (n, 7) through the joints that is not the links', positive where the arm pushes."""
    data = model.createData()
    q, dq, ddq, tau_J = smooth(records["q"]), smooth(records["dq"]), rate(records["dq"]), smooth(records["tau_J"])
    own = [pin.rnea(model, data, *row) + pin.computeJointTorqueRegressor(model, data, *row) @ inertial
           for row in zip(q, dq, ddq, strict=True)]  # fmt: skip
    return tau_J - np.array(own)


def _seen(values: Array, cutoff_hz: float) -> Array:
    """Return what an estimate without delay shows of values (n, ...) at the ticks: the last ms's mean, low-passed."""
    mean = values.copy()
    mean[1:] = 0.5 * (values[1:] + values[:-1])
    gain = 1.0 - np.exp(-2.0 * np.pi * cutoff_hz * PERIOD_S)
    return np.asarray(lfilter([gain], [1.0, gain - 1.0], mean - mean[0], axis=0)) + mean[0]


def _runs(true: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return where each run of true values begins and ends."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], true.astype(np.int8), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
