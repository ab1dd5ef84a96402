"""Recordings: what can be extracted from one, what a person thinks of it, and throwing it away."""

from dataclasses import dataclass, replace
from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.exceptions import HTTPException

from console.log_rows import RECORDINGS
from console.parts import NeedsParts, NeedsSession, Parts, written_now
from console.routes.problems import problems
from rtstack.log.catalogue import LogEntry
from rtstack.log.errors import LogError
from rtstack.references.acceptance import Acceptance, load_acceptance, save_acceptance
from rtstack.references.recording import ReferenceError
from rtstack.retention.trash import delete as throw_away
from rtstack.trials.extraction import Extraction, extract

router = APIRouter(prefix="/api/recordings", tags=["recordings"], responses=problems(404, 409, 500))


@dataclass(frozen=True, slots=True)
class RecordingView:
    """What was said about a recording, and what is extracted from it."""

    acceptance: Acceptance
    extraction: Extraction


@dataclass(frozen=True, slots=True)
class Discarded:
    """Says that the recording is in the trash."""

    discarded: bool


@router.get("/{log_id}")
def recording(
    log_id: str,
    parts: NeedsParts,
    nominal_impact_s: Annotated[float | None, Query(ge=0.0, le=3600.0, allow_inf_nan=False)] = None,
) -> RecordingView:
    """Return what was said about a recording and what is extracted from it; nominal_impact_s: as if it were there."""
    entry = recording_entry(parts, log_id)
    acceptance = load_acceptance(entry.path)
    tried = acceptance if nominal_impact_s is None else replace(acceptance, nominal_impact_s=nominal_impact_s)
    try:
        extraction = extract(entry.path, parts.cell, tried)
    except ReferenceError as error:
        raise HTTPException(409, str(error).replace(f"{entry.path}: ", "")) from None
    problem = extraction.problem and extraction.problem.replace(f"{entry.path}: ", "")
    return RecordingView(acceptance, replace(extraction, problem=problem))


@router.post("/{log_id}")
def accept(log_id: str, acceptance: Acceptance, parts: NeedsParts) -> Acceptance:
    """Say what a recording is called, and whether it may be followed. An accepted one has to give a reference."""
    entry = recording_entry(parts, log_id)
    if acceptance.verdict == "accepted":
        try:
            problem = extract(entry.path, parts.cell, acceptance).problem
        except ReferenceError as error:
            problem = str(error)
        if problem is not None:
            raise HTTPException(409, problem.replace(f"{entry.path}: ", ""))
    save_acceptance(entry.path, acceptance)
    return acceptance


@router.post("/{log_id}/discard")
def discard(log_id: str, session: NeedsSession, parts: NeedsParts) -> Discarded:
    """Throw a recording away: it is moved to the trash, from where it comes back. Not the one that is being written."""
    entry = recording_entry(parts, log_id)
    if entry.path.name == written_now(parts):
        raise HTTPException(409, "it is being recorded; finish it first")
    throw_away(entry.path)
    return Discarded(True)


def recording_entry(parts: Parts, log_id: str) -> LogEntry:
    """Return the recording of an id. Raises HTTPException."""
    try:
        entry = parts.catalogue.entry(log_id)
    except LogError:
        raise HTTPException(404, "there is no such recording; choose one from the list") from None
    if entry.kind not in RECORDINGS:
        raise HTTPException(404, "this log is no recording")
    return entry
