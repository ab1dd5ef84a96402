"""The list of logs as the page shows it: what was asked, what came out, one row a file."""

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import Any

from rtstack.log.errors import LogError
from rtstack.log.writing.job import values_of
from rtstack.log_folder.catalogue import Catalogue, LogCondition, LogEntry
from rtstack.log_folder.remarks import EpisodeVerdict, Remarks, load_remarks
from rtstack.loop.end import OUTSIDE, End
from rtstack.monitor.records import Verdict
from rtstack.references.acceptance import Acceptance, AcceptanceError, AcceptanceState, load_acceptance

BY_HAND = "recording"
RECORDINGS = ("demonstration", BY_HAND)
PLAN = "plan"  # of `rtstack plan`: a planned recording
_ABORTS = OUTSIDE | {End.HARDWARE, End.TICK_OVERRUN, End.TORQUE_NOT_TAKEN}  # no doing of the controller


_SHOWN = (
    "success", "failure_reason", "controller", "object", "seed", "displacement_mm", "displacement_x_mm", "yaw_deg",
    "max_lift_mm", "average_force_norm", "impact_verdict", "impact_kind", "note",
)  # fmt: skip


class Ending(StrEnum):
    """How a run ended, in the words that lists and cards colour. An impact that was not meant is no plain success."""

    SUCCESS = "success"
    UNEXPECTED = "unexpected impact"
    FAILURE = "failure"
    ABORTED = "aborted"
    NONE = "no result"


@dataclass(frozen=True, slots=True)
class LogRow:
    """One log. `ending` in a word, `outcome` in one line; `when` is Unix time of the last change, s.

    recording: a trial may follow it; title and decision: a person's, for a recording. starred, tags, note and
    episode_verdict: a person's, for any log. law_inertia: the mass matrix of the controller's law.
    """

    id: str
    name: str
    kind: str
    controller: str | None
    object: str | None
    displacement_mm: float | None
    seed: int | None
    success: bool | None
    outcome: str
    verdict: str | None
    note: str | None
    average_force_norm: float | None
    max_lift_mm: float | None
    when: float
    size_bytes: int
    recording: bool
    title: str
    decision: str | None
    displacement_x_mm: float | None
    yaw_deg: float | None
    law_inertia: str | None
    ending: Ending
    starred: bool
    tags: tuple[str, ...]
    episode_verdict: EpisodeVerdict | None = None


class NoReference(Exception):
    """A log that no trial may follow. The message is one line."""


def reference_of(catalogue: Catalogue, log_id: str) -> LogEntry:
    """Return what a trial may follow: an accepted recording or a plan. Raises NoReference, LogError for no log."""
    entry = catalogue.entry(log_id)
    if not log_row(entry, None).recording:
        raise NoReference("no trial may follow this log; choose an accepted recording or a plan")
    return entry


def log_row(entry: LogEntry, being_written: str | None) -> LogRow:
    """Return the row of one log; `being_written` names the running job's file."""
    values = _values(entry)
    seed = _number(values.get("seed"))
    success = values.get("success") if isinstance(values.get("success"), bool) else None
    acceptance, remarks = _acceptance(entry), remarks_on(entry)
    decision = None if acceptance is None else acceptance.verdict
    return LogRow(
        displacement_mm=_number(values.get("displacement_mm")), yaw_deg=_number(values.get("yaw_deg")),
        displacement_x_mm=_number(values.get("displacement_x_mm")), max_lift_mm=_number(values.get("max_lift_mm")),
        average_force_norm=_number(values.get("average_force_norm")),
        id=entry.id, name=entry.path.name, when=entry.modified_s, size_bytes=entry.size_bytes,
        kind="not ours" if entry.condition is LogCondition.FOREIGN else entry.kind,
        controller=_text(values.get("controller")), object=_text(values.get("object")),
        seed=None if seed is None else int(seed), success=success,
        ending=_ending(success, values),
        outcome=_outcome(entry, entry.path.name == being_written, success, values),
        verdict=_text(values.get("impact_verdict")) or ("not watched" if "impact_verdict" in values else None),
        note=remarks.note or (acceptance.note if acceptance is not None else "") or _text(values.get("note")),
        recording=_is_plan(entry) or (success is True and _may_be_followed(entry.kind, decision)),
        title=acceptance.name if acceptance is not None else "", decision=None if decision is None else str(decision),
        law_inertia=(entry.trial or {}).get("law_inertia"), starred=remarks.starred, tags=remarks.tags,
        episode_verdict=remarks.verdict,
    )  # fmt: skip


@lru_cache(maxsize=20_000)
def _values(entry: LogEntry) -> dict[str, Any]:
    """Return what a row shows of a log's metadata. Kept: a log has ten times as many, and a list has thousands."""
    trial = values_of(entry.trial)
    asked = trial.get("specification")
    values = {**trial, **(asked if isinstance(asked, dict) else {}), **values_of(entry.result)}
    return {key: values[key] for key in _SHOWN if key in values}


def remarks_on(entry: LogEntry) -> Remarks:
    """Return what people say about a log, nothing where the file with it is broken."""
    with contextlib.suppress(LogError):
        return load_remarks(entry.path)
    return Remarks()


def _acceptance(entry: LogEntry) -> Acceptance | None:
    """What was said about a recording, None about any other log, or where the file about it is broken."""
    with contextlib.suppress(AcceptanceError):
        return load_acceptance(entry.path) if entry.kind in RECORDINGS else None
    return None


def _may_be_followed(kind: str, verdict: AcceptanceState | None) -> bool:
    """A hand's recording once it was accepted, a scripted one until it is rejected."""
    return verdict is AcceptanceState.ACCEPTED or (kind != BY_HAND and verdict not in (None, AcceptanceState.REJECTED))


def _is_plan(entry: LogEntry) -> bool:
    return entry.kind == PLAN and entry.condition is LogCondition.COMPLETE


def _ending(success: bool | None, values: Mapping[str, Any]) -> Ending:
    if success is None:
        return Ending.NONE
    if not success:
        return Ending.ABORTED if End.in_reason(_text(values.get("failure_reason"))) in _ABORTS else Ending.FAILURE
    return Ending.UNEXPECTED if values.get("impact_verdict") == Verdict.UNEXPECTED.name.lower() else Ending.SUCCESS


def _outcome(entry: LogEntry, being_written: bool, success: bool | None, values: Mapping[str, Any]) -> str:
    if being_written or entry.condition is LogCondition.FOREIGN:
        return "being written" if being_written else "not a log of rtstack"
    if success is None and entry.condition is LogCondition.TRUNCATED:
        return "cut off: rtstack recover gives back the rest"
    if success is None:
        return "planned" if _is_plan(entry) else "no result"
    if not success:
        return f"failed: {values.get('failure_reason') or 'no reason given'}"
    if _ending(success, values) is Ending.UNEXPECTED:
        kind = values.get("impact_kind")
        return f"the object was held, the impact was not as meant{f': probably {kind}' if kind else ''}"
    return "success"


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) else None


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)
