"""What logs with contact say: how late the robot's estimate of external torques is, and how stiff a pad on an object.

The estimate is taken as the simulated robot makes it: the mean over a millisecond, a first-order low-pass, a delay:
that of the torque which the links' motion leaves unexplained. Both pads press on one object: the squeeze is k times how
far each goes in, half of what the pads come together, and a damper's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from hal.base.arrays import Array
from rtstack.identification.arm import CONTACT_N, PERIOD_S, WINDOW, rate, smooth, touches
from rtstack.identification.estimate import Estimate, curve, linear

LONGEST_MS = 50.0
BLOCK = 100  # ticks that share their errors: a pad's vibration dies out in some 100 ms
AROUND = 200  # ticks before and after a contact begins or ends, in which an estimate shows how late it is
# between the pads' faces: beyond it one of them stands on an edge, a face of 0.1 m that presses with 30 N on 40 kN/m
FLAT_RAD = 0.015
UNKNOWN = Estimate(np.zeros(1), np.full(1, np.inf))


@dataclass(frozen=True, slots=True)
class ContactLog:
    """The ARM_SAMPLE records (n,) of each arm, and what its inertial parameters (70,) lack in the model."""

    arms: tuple[NDArray, ...]
    inertial: tuple[Array, ...]


def estimate_delay(model: pin.Model, logs: Sequence[ContactLog], side: int, cutoff_hz: float) -> Estimate:
    """Return how late the estimate of an arm, by its number, is beyond a low-pass of cutoff_hz, (1,), ms: by the fitted
    inertial parameters or the description's, whichever explain the contacts better, which no fit of them has seen."""
    described = [ContactLog(log.arms, (np.zeros(70),) * len(log.arms)) for log in logs]
    found, _ = min((_delay(model, each, side, cutoff_hz) for each in (logs, described)), key=lambda each: each[1])
    return found


def _delay(model: pin.Model, logs: Sequence[ContactLog], side: int, cutoff_hz: float) -> tuple[Estimate, float]:
    """Return the delay, and the sum of squares that is left."""
    left, shown, blocks = [], [], []
    for number, log in enumerate(logs):
        records = log.arms[side]
        changes = np.flatnonzero(np.diff(touches(records).astype(np.int8)))
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
        return UNKNOWN, 0.0

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
    found = curve(residual, np.array([best]), bounds, np.ones(1), np.concatenate(blocks))
    return found, float(np.sum(residual(found.value) ** 2))


def contact_stiffness(
    models: Sequence[pin.Model], faces: Sequence[pin.SE3], logs: Sequence[ContactLog], offsets: Sequence[Array],
    delays_ms: Sequence[float], cutoff_hz: float,
) -> Estimate:  # fmt: skip
    """Return the stiffness of a pad's face on what both pads hold, silicone and wall in series, (1,), N/m. Of both
    arms: models, the frames of their pads' faces in their last joints, and how far the estimates of external torques
    are off, (7,) Nm, and how late."""
    columns, forces, blocks = [], [], []
    for number, log in enumerate(logs):
        n = min(map(len, log.arms))
        touched = np.flatnonzero(touches(log.arms[0][:n]) & touches(log.arms[1][:n]))
        if not len(touched):
            continue
        part = slice(max(0, touched[0] - 2 * WINDOW), touched[-1] + 2 * WINDOW)
        ticks = np.arange(len(log.arms[0][:n][part]), dtype=float)
        poses, pushes = zip(
            *(
                _pressed(*each)
                for each in zip(models, faces, (arm[:n][part] for arm in log.arms), offsets, strict=True)
            ),
            strict=True,
        )
        axes = [pose[:, :, 2] for pose in poses]
        normal = axes[0] - axes[1]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        inward = 0.5 * np.sum((poses[0][:, :, 3] - poses[1][:, :, 3]) * normal, axis=1)
        flat = np.linalg.norm(np.cross(*axes), axis=1) < FLAT_RAD
        held = flat & np.all([smooth(push) > 2.0 * CONTACT_N for push in pushes], axis=0)
        delay = float(np.mean(delays_ms))
        seen = [_seen(np.interp(ticks - delay, ticks, values), cutoff_hz) for values in (smooth(inward), rate(inward))]
        squeeze = smooth(0.5 * (pushes[0] + pushes[1]))
        for begin, end in _runs(held):
            if end - begin < 2 * WINDOW:
                continue
            run = slice(begin, end)
            columns.append(np.column_stack([values[run] - values[run].mean() for values in seen]))
            forces.append(squeeze[run] - squeeze[run].mean())
            blocks.append(100_000 * number + np.arange(begin, end) // BLOCK)
    if not columns:
        return UNKNOWN
    found = linear(np.concatenate(columns), np.concatenate(forces), np.concatenate(blocks))
    return Estimate(found.value[:1], found.half_width[:1])


def _pressed(model: pin.Model, face: pin.SE3, records: NDArray, offset: Array) -> tuple[Array, Array]:
    """Return where a pad's face is, (n, 3, 4) in the world, and with what force it presses along its own z (n,), N."""
    data, last, inverse = model.createData(), model.njoints - 1, face.toActionMatrixInverse()
    poses, J = np.empty((len(records), 3, 4)), np.empty((len(records), 6, 7))
    for k, q in enumerate(records["q"]):
        pin.forwardKinematics(model, data, q)
        J[k] = inverse @ pin.computeJointJacobian(model, data, q, last)
        poses[k] = (data.oMi[last] * face).homogeneous[:3]
    tau = records["tau_ext_hat_filtered"] - offset
    wrench = np.linalg.solve(J @ J.transpose(0, 2, 1), J @ tau[:, :, None])
    return poses, np.asarray(wrench[:, 2, 0], np.float64)


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
