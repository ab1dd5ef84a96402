"""The card of a trial: how it ended, in a word and a sentence; three numbers beside earlier trials'; its impact."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from statistics import fmean, stdev

import numpy as np
from numpy.typing import NDArray

from console.orders import TrialOrder
from console.refused import Refused
from hal.base.arrays import Array
from hal.displacement import Displacement
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.log_folder.catalogue import Catalogue, LogCondition, LogEntry
from rtstack.log_folder.log_rows import Ending, LogRow, NoReference, log_row, reference_of
from rtstack.model.cell_description import base_frame
from rtstack.references.recording import described_in
from rtstack.samples import LawInertia, Mode
from rtstack.topics import ARM_TOPICS, CONTROL_TOPICS
from rtstack.trials.errors import TrialError
from rtstack.trials.specification import TrialSpecification, like, specification_of

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


TRIAL = "trial"
COMPARED = 10
_POINTS = 300


@dataclass(frozen=True, slots=True)
class Number:
    """One number of a trial, None where it has none. before: of earlier trials, the newest first, with their mean and
    standard deviation (None for fewer than two); about: what it is, in a sentence.
    """

    name: str
    unit: str
    about: str
    value: float | None
    before: tuple[float, ...]
    mean: float | None
    spread: float | None


@dataclass(frozen=True, slots=True)
class TrialCard:
    """The card of a trial. what: the order in words; sentence: how it ended and why; compared: number of earlier trials
    with this object that the numbers are compared with, at most ten; before: id of the newest earlier trial. again: the
    order, for a repetition; None if its reference can no longer be followed, with the reason in `refusal`.
    """

    row: LogRow
    ending: Ending
    what: str
    sentence: str
    numbers: tuple[Number, ...]
    compared: int
    impact: Impact | None
    before: str | None
    again: TrialOrder | None
    refusal: str | None


_Value = Callable[[LogRow, Impact | None], float | None]

_NUMBERS: tuple[tuple[str, str, str, _Value], ...] = (
    (
        "Peak force at impact", "N",
        "The largest force that a pad felt, from 20 ms before the detected impact to 200 ms after it; the larger arm's",
        lambda row, impact: None if impact is None else impact.peak_force_n,
    ),
    (
        "Mean force norm", "",
        "Mean of the norm (33) of both arms' interaction wrenches, N and Nm, over 200 ms around the nominal impact",
        lambda row, impact: row.average_force_norm,
    ),
    (
        "Tracking error", "mm",
        "The largest distance of a pad from its reference within 200 ms after the impact; the larger arm's",
        lambda row, impact: None if impact is None else impact.error_mm,
    ),
)  # fmt: skip


def trial_card(catalogue: Catalogue, log_id: str) -> TrialCard:
    """Return the card of a trial. Raises Refused, LogError."""
    entries = catalogue.entries()
    entry = next((each for each in entries if each.id == log_id), None)
    if entry is None or entry.kind != TRIAL:
        raise Refused(404, "there is no such trial; look at the list of logs again")
    row = log_row(entry, None)
    earlier = [each for each in entries if each.kind == TRIAL and each.modified_s < entry.modified_s]
    alike = [(each, log_row(each, None)) for each in earlier]
    alike = [(each, its) for each, its in alike if its.object == row.object and its.success is not None][:COMPARED]
    impact = impact_of(entry)
    known = [(row, impact), *((its, impact_of(each)) for each, its in alike)]
    numbers = []
    for name, unit, about, value in _NUMBERS:
        now, *found = (value(its, hit) for its, hit in known)
        before = tuple(each for each in found if each is not None)
        mean, spread = fmean(before) if before else None, stdev(before) if len(before) > 1 else None
        numbers.append(Number(name, unit, about, now, before, mean, spread))
    again, refusal = _again(entries, catalogue, entry)
    place = Displacement.given(row.displacement_mm or 0.0, row.displacement_x_mm or 0.0, row.yaw_deg or 0.0).in_words
    plain = ", ".join((text or "").replace("_", " ") for text in (row.controller, row.object))
    law = f", law with {row.law_inertia}" if row.law_inertia == LawInertia.LINKS else ""
    what = f"{plain}, {place}, seed {row.seed}{law}"
    return TrialCard(
        row, row.ending, what, _sentence(row, impact), tuple(numbers), len(alike),
        None if impact is None else thinned(impact, _POINTS), earlier[0].id if earlier else None, again, refusal,
    )  # fmt: skip


def _sentence(row: LogRow, impact: Impact | None) -> str:
    outcome = row.outcome.replace("failed", row.ending, 1) if row.ending is Ending.ABORTED else row.outcome
    said = f"{outcome[:1].upper()}{outcome[1:]}."
    if row.ending is Ending.SUCCESS:
        words = {"expected": "the impact was the one that was meant", "not watched": "no monitor judged the impact"}
        said = f"Held until release; {words.get(row.verdict or '', 'the monitor came to no verdict on the impact')}."
    if impact is None:
        return said
    late = -impact.nominal_ms
    detected = f"Detected {abs(late):.0f} ms {'after' if late >= 0 else 'before'} the nominal impact."
    return f"{said} {detected if impact.detected else 'No impact was detected.'}"


def _again(entries: Sequence[LogEntry], catalogue: Catalogue, entry: LogEntry) -> tuple[TrialOrder | None, str | None]:
    """Return the order of a trial, or why it cannot be given again. Its reference is known by its file's name."""
    try:
        asked = specification_of(entry.trial or {})
    except TrialError as error:
        return None, str(error)
    assert isinstance(asked, TrialSpecification)  # as the kind of its log
    name = Path(asked.reference).name
    found = next((each for each in entries if each.path.name == name), None)
    if found is None:
        return None, f"its reference {name} is not among the logs"
    try:
        reference_of(catalogue, found.id)
    except (NoReference, LogError) as error:
        return None, f"its reference {name}: {error}"
    return like(TrialOrder, asked, reference=found.id, safety=()), None
