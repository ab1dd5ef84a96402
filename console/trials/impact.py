"""The impact in a log: the forces on both pads around it, and how far the pads were from where they were to be."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.log_folder.catalogue import LogCondition, LogEntry
from rtstack.model.cell_description import base_frame
from rtstack.references.recording import described_in
from rtstack.samples import Mode
from rtstack.topics import ARM_TOPICS, CONTROL_TOPICS

# what is shown, and of which the largest values are taken: a displaced object meets the other arm later
BEFORE_S, AFTER_S = 0.1, 0.2
_EARLY_S = 0.02  # a force has risen for some ticks before the impact is detected
_REMEMBERED = 256
_MS = 1e3


@dataclass(frozen=True, slots=True)
class Impact:
    """t_ms: since the detected impact, the nominal one where none was detected; left and right: force on each pad, N.

    modes: (from ms, to ms, mode) of the left arm. at_s: the impact, s since the log's first message; nominal_ms: when
    it was meant. Of both pads: the largest force, and distance from its reference up to 200 ms after the impact.
    """

    t_ms: tuple[float, ...]
    left: tuple[float, ...]
    right: tuple[float, ...]
    modes: tuple[tuple[float, float, str], ...]
    at_s: float
    detected: bool
    nominal_ms: float
    peak_force_n: float | None
    error_mm: float | None


def impact_of(entry: LogEntry) -> Impact | None:
    """Return a trial's impact, None where its log has none, or cannot be read."""
    if entry.condition is not LogCondition.COMPLETE:
        return None
    return _impact(entry.path, entry.size_bytes, entry.modified_s)


@lru_cache(maxsize=_REMEMBERED)
def _impact(path: Path, _size_bytes: int, _modified_s: float) -> Impact | None:
    try:
        return _read_impact(read_log(path))
    except (LogError, OSError, ValueError):  # or one that is not as ours are
        return None


def _read_impact(log: Log) -> Impact | None:
    result, trial = log.metadata.get("result", {}), log.metadata.get("trial", {})
    if (first_ns := log.first_ns(ARM_TOPICS[0])) is None or "nominal_impact_s" not in trial:
        return None
    nominal_s, found = float(trial["nominal_impact_s"]), result.get("detected_impact_time_s", "null")
    detected = found != "null"
    at_s = float(found) if detected else nominal_s
    at_ns = first_ns + round(at_s * 1e9)
    records = log.between([*ARM_TOPICS, *CONTROL_TOPICS], at_ns - round(BEFORE_S * 1e9), at_ns + round(AFTER_S * 1e9))
    arms, controls = ([records[topic] for topic in topics] for topics in (ARM_TOPICS, CONTROL_TOPICS))
    n = min(len(each) for each in (*arms, *controls))
    if n == 0:
        return None
    arms, controls = [arm[:n] for arm in arms], [control[:n] for control in controls]
    t_s = (arms[0]["t_ns"] - at_ns) * 1e-9
    force = np.array([np.linalg.norm(arm["O_F_ext_hat_K"][:, :3], axis=1) for arm in arms])
    moving = np.array([control["mode"] != Mode.STOPPING for control in controls]).all(axis=0)
    hit = (t_s >= -_EARLY_S) & (t_s <= AFTER_S)
    after = (t_s >= 0.0) & (t_s <= AFTER_S) & moving
    error = _error_m(log, arms, controls)
    return Impact(
        _rounded(t_s * _MS, 1), _rounded(force[0], 2), _rounded(force[1], 2), _modes(t_s * _MS, controls[0]["mode"]),
        (at_ns - log.start_ns) * 1e-9, detected, (nominal_s - at_s) * _MS,
        peak_force_n=float(force[:, hit].max()) if hit.any() else None,
        error_mm=float(error[:, after].max()) * _MS if error is not None and after.any() else None,
    )  # fmt: skip


def _error_m(log: Log, arms: list[NDArray], controls: list[NDArray]) -> Array | None:
    """Return the distance of each pad from its reference (2, n), m; None where the log has no cell."""
    if (cell := described_in(log)) is None:
        return None
    distances = []
    for mounting, arm, control in zip(cell.arms, arms, controls, strict=True):
        frame = base_frame(mounting)
        place = arm["O_T_EE"][:, :3, 3] @ frame.rotation.T + frame.translation
        distances.append(np.linalg.norm(place - control["pose_ref"][:, :3], axis=1))
    return np.array(distances)


def _modes(t_ms: Array, modes: NDArray) -> tuple[tuple[float, float, str], ...]:
    starts, times = np.flatnonzero(np.diff(modes, prepend=modes[0] - 1)), _rounded(t_ms, 1)
    ends = [*starts[1:].tolist(), len(modes) - 1]
    return tuple((times[k], times[end], Mode(int(modes[k])).name) for k, end in zip(starts, ends, strict=True))


def _rounded(values: Array, digits: int) -> tuple[float, ...]:
    return tuple(np.round(values.astype(np.float64), digits).tolist())


def thinned(impact: Impact, points: int) -> Impact:
    """Return an impact with so many points at most, each the largest of its neighbours: peaks stay."""
    step = -(-len(impact.t_ms) // points)
    if step <= 1:
        return impact
    starts = range(0, len(impact.t_ms), step)
    left, right = (tuple(max(side[start : start + step]) for start in starts) for side in (impact.left, impact.right))
    return replace(impact, t_ms=impact.t_ms[::step], left=left, right=right)
