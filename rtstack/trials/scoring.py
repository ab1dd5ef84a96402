"""A result from the samples of a trial: the same function on the memory of a run and on a log that was read back."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.robots import FR3
from rtstack.loop.history import Columns
from rtstack.references.motion import Motion
from rtstack.samples import Mode

Bases = tuple[Array, ...]  # T_world_base (4, 4) of each arm
UPRIGHT: Bases = (np.eye(4), np.eye(4))  # at the world's origin: where only differences of places count


def pad_forces(columns: Columns, bases: Bases) -> Array:
    """Return the force of each pad on its surroundings (arms, n, 3), N, along the world's axes, as it is estimated."""
    force = columns.arm["O_F_ext_hat_K"][:, :, :3]
    return np.stack([of @ base[:3, :3].T for of, base in zip(force, bases, strict=True)])


def pad_places(columns: Columns, bases: Bases) -> Array:
    """Return where the middle of each pad's face is in the world (arms, n, 3), m."""
    places = columns.arm["O_T_EE"][:, :, :3, 3]
    return np.stack([of @ base[:3, :3].T + base[:3, 3] for of, base in zip(places, bases, strict=True)])


@dataclass(frozen=True, slots=True)
class SuccessCriterion:
    """A grab succeeds when the object follows the pads until release, and no safety limit was hit. From the moment the
    pads have risen by `lifted_m`, the object's height over where it stood may be at most `slip_m` below the pads' rise
    since the impact: half a pad's height less a margin, past which the pads' centres leave it. A push succeeds when the
    object has gone `pushed_m` at least, and never `apart_m` more or less than the pad since the impact. In a cell
    without a tracker a grab is judged by the pads alone: while they are up, they are never `closer_m` nearer to each
    other than when they have come up, and both feel `squeeze_n` at least, N, in the mean of 50 ms."""

    lifted_m: float = 0.06
    slip_m: float = 0.04
    release_margin_s: float = 0.05
    pushed_m: float = 0.06
    apart_m: float = 0.02
    closer_m: float = 0.015
    squeeze_n: float = 5.0


@dataclass(frozen=True, slots=True)
class Score:
    """What the samples say. See TrialResult for the meaning of each. seen: the tracker saw the object meanwhile.
    by_pads: no tracker sees it, and `held` is told from the pads."""

    seen: bool
    by_pads: bool
    held: bool
    average_force_norm: float | None
    average_force_norm_linear_n: float | None
    peak_force_norm: float | None
    max_lift_mm: float | None
    peak_torque_ratio: float
    peak_velocity_ratio: float
    detected_impact_time_s: float | None
    ticks: int
    missed_deadlines: int
    compute_us_p50: float
    compute_us_p99: float


_MEAN_TICKS = 50
FORCE_WINDOW_S = 0.1  # on each side of the nominal impact time: the 200 ms of the paper's Figure 11


def score(
    columns: Columns, start_t_ns: int, nominal_impact_s: float, release_s: float,
    detected_impact_s: float | None, criterion: SuccessCriterion, motion: Motion = Motion.GRAB,
    urdfs: Sequence[str] = (FR3.urdf, FR3.urdf), bases: Bases | None = None, unobserved: bool = False,
) -> Score:  # fmt: skip
    """Score a trial that began at the robot's time start_t_ns. urdfs: of each arm. bases: where they stand; None: not
    known, taken for upright. unobserved: the cell has no tracker; where the bases are known the pads tell what the
    object did."""
    ratings = np.stack([_ratings(urdf) for urdf in urdfs])
    t_s = (columns.arm[0]["t_ns"] - start_t_ns) * 1e-9
    wrench = columns.control["wrench_desired"]  # (2, n, 6)
    moving = columns.control[0]["mode"] != Mode.STOPPING
    window = (np.abs(t_s - nominal_impact_s) <= FORCE_WINDOW_S + 1e-9) & moving
    written = bool(wrench[:, moving].any())  # else the law of another author has left it out, and there is no norm
    norm = np.linalg.norm(wrench, axis=(0, 2))
    linear = np.linalg.norm(wrench[:, :, :3], axis=(0, 2))
    compute = columns.timing["compute_us"]
    end_s = release_s - criterion.release_margin_s
    seen = bool(np.any(columns.object["t_ns"] > start_t_ns))  # what waited in the socket before is no evidence
    held, by_pads = False, unobserved and bases is not None and not seen and motion is Motion.GRAB
    pads = pad_places(columns, UPRIGHT if bases is None else bases)
    if detected_impact_s is not None and t_s[-1] >= end_s:
        if by_pads:
            held = _squeezed(columns, pads, t_s, detected_impact_s, end_s, criterion)
        elif seen:
            held = _followed(columns, pads, start_t_ns, t_s, detected_impact_s, end_s, criterion, motion)
    return Score(
        seen=seen,
        by_pads=by_pads,
        held=held,
        average_force_norm=_mean(norm[window]) if written else None,
        average_force_norm_linear_n=_mean(linear[window]) if written else None,
        peak_force_norm=float(norm.max()) if written else None,
        max_lift_mm=float(_lift(columns.object).max()) * 1e3 if seen else None,
        peak_torque_ratio=float(np.max(np.abs(columns.arm["tau_J"]) / ratings[:, :1], initial=0.0)),
        peak_velocity_ratio=float(np.max(np.abs(columns.arm["dq"]) / ratings[:, 1:], initial=0.0)),
        detected_impact_time_s=detected_impact_s,
        ticks=len(t_s),
        missed_deadlines=int(columns.timing["missed_deadlines"][-1]) if len(t_s) else 0,
        compute_us_p50=float(np.percentile(compute, 50)) if len(t_s) else 0.0,
        compute_us_p99=float(np.percentile(compute, 99)) if len(t_s) else 0.0,
    )


@lru_cache(maxsize=16)
def _ratings(urdf: str) -> Array:
    """Return the limits of torque Nm and velocity rad/s that a URDF states, (2, 7)."""
    limits = [joint.attrib for joint in ElementTree.fromstring(urdf).iter("limit")]
    return np.array([[float(limit[name]) for limit in limits] for name in ("effort", "velocity")])


def _mean(values: Array) -> float | None:
    return float(values.mean()) if len(values) else None


def _lift(poses: NDArray) -> Array:
    """How far the object is above where it stood at first (n,), m."""
    height = poses["position"][:, 2]
    return height - np.median(height[:20])


def _risen(pads: Array, t_s: Array, impact_s: float) -> Array:
    """How far the pads (2, n, 3) are above where they were at the impact, m: where the bases stand drops out."""
    pad_z = pads[:, :, 2].mean(axis=0)
    return pad_z - pad_z[_tick(t_s, impact_s)]


def _tick(t_s: Array, at_s: float) -> int:
    return min(int(np.searchsorted(t_s, at_s)), len(t_s) - 1)


def _squeezed(
    columns: Columns, pads: Array, t_s: Array, impact_s: float, end_s: float, criterion: SuccessCriterion
) -> bool:
    """Whether the pads had something between them from the lift to the release."""
    gap = np.linalg.norm(pads[0] - pads[1], axis=1)
    force = np.linalg.norm(columns.arm["O_F_ext_hat_K"][:, :, :3], axis=2)
    carried = (t_s > impact_s) & (t_s < end_s) & (_risen(pads, t_s, impact_s) > criterion.lifted_m)
    if np.count_nonzero(carried) < _MEAN_TICKS:
        return False
    means = [np.convolve(side[carried], np.full(_MEAN_TICKS, 1.0 / _MEAN_TICKS), "valid") for side in force]
    together = gap[carried] > gap[carried][0] - criterion.closer_m
    return bool(together.all() and np.min(means) >= criterion.squeeze_n)


def _followed(
    columns: Columns, pads: Array, start_t_ns: int, t_s: Array, impact_s: float, end_s: float,
    criterion: SuccessCriterion, motion: Motion,
) -> bool:  # fmt: skip
    """Whether the object went with the pads between impact_s and end_s: up from the lift to the release, or along the
    left pad's way over the table. Where the bases stand drops out."""
    poses = columns.object
    pose_t_s = (poses["t_ns"] - start_t_ns) * 1e-9
    during = (pose_t_s > impact_s) & (pose_t_s < end_s)
    if motion is Motion.GRAB:
        rise = np.interp(pose_t_s, t_s, _risen(pads, t_s, impact_s))
        carried = during & (rise > criterion.lifted_m)
        return bool(carried.any() and np.all(_lift(poses)[carried] > rise[carried] - criterion.slip_m))
    pad, place = pads[0, :, :2], poses["position"][:, :2]
    way = np.linalg.norm(pad - pad[_tick(t_s, impact_s)], axis=1)
    gone = np.linalg.norm(place - np.median(place[:20], axis=0), axis=1)
    apart = np.abs(gone - np.interp(pose_t_s, t_s, way))[during]
    return bool(gone[during].max(initial=0.0) > criterion.pushed_m and apart.max(initial=0.0) <= criterion.apart_m)


def object_problem(values: Score, motion: Motion) -> str | None:
    """Return why a trial failed whose session did not, by what the object did; None for a success."""
    if values.held:
        return None
    if values.by_pads:
        return "the pads did not hold the object until release, by their gap and force"
    if not values.seen:
        return "the object was never seen: no pose of the tracker arrived; see [tracker] in the cell's file"
    return f"the object was not {'held' if motion is Motion.GRAB else 'pushed along'} until release"
