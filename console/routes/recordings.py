"""Recordings: what can be extracted from one, what a person thinks of it, and throwing it away."""

from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query
from fastapi.exceptions import HTTPException
from fastapi.responses import Response
from pydantic import TypeAdapter

from console.parts import NeedsParts, NeedsSession, Parts, written_now
from console.questions.questions import Question
from console.review.columns import LogColumns
from console.review.logs import listed, opened
from console.routes.problems import file_of, problems
from rtstack.figures.style import COLOURS
from rtstack.log.analysis.signals import signals
from rtstack.log_folder.catalogue import LogEntry
from rtstack.log_folder.log_rows import RECORDINGS
from rtstack.log_folder.remarks import EpisodeVerdict, load_remarks, save_remarks
from rtstack.log_folder.trash import delete as throw_away
from rtstack.references.acceptance import Acceptance, AcceptanceState, load_acceptance, save_acceptance
from rtstack.samples import SIDES
from rtstack.trials.extraction import Extraction

router = APIRouter(prefix="/api/recordings", tags=["recordings"], responses=problems(404, 409, 500))

Seconds = Annotated[float, Query(ge=0.0, le=3600.0, allow_inf_nan=False)]
_EXTRACTION = TypeAdapter(Extraction)
_VERDICTS = {AcceptanceState.ACCEPTED: EpisodeVerdict.KEPT, AcceptanceState.REJECTED: EpisodeVerdict.FAILED}
_NOT_YET: dict[int | str, dict[str, Any]] = {202: {"description": "it is being read: ask again"}}
WIDTH, HEIGHT = 160, 36  # px
_LEAST_N = 5.0  # of the height: noise does not fill the picture


def forces_svg(log: LogColumns) -> str:
    """Return the drawing. Raises Refused."""
    colours = dict(zip(SIDES, COLOURS, strict=False))
    peaks = {side: _peaks(log, side) for side in log.index.sides}
    highest = max(_LEAST_N, *(float(peak.max()) for peak in peaks.values()))
    lines = ""
    for side, peak in peaks.items():
        points = " ".join(f"{px},{HEIGHT - 1 - n / highest * (HEIGHT - 3):.1f}" for px, n in enumerate(peak))
        lines += f'<polyline points="{points}" fill="none" stroke="{colours[side]}" stroke-width="1.3"/>'
    size = f'width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}><title>{highest:.0f} N at most</title>{lines}</svg>'


def _peaks(log: LogColumns, side: str) -> np.ndarray:
    """Return the largest force of each pixel, (WIDTH,) N."""
    signal, found = signals()[f"{side}.pad_force"], np.zeros(WIDTH)
    columns = log.of(signal.topic)
    if columns is not None:
        high = np.nan_to_num(columns.high[signal.column])
        high = np.repeat(high, -(-WIDTH // len(high)))  # a short log has fewer buckets than there are pixels
        np.maximum.at(found, (np.arange(len(high)) * WIDTH / len(high)).astype(int), high)
    return found


@dataclass(frozen=True, slots=True)
class RecordingView:
    """What was said about a recording, and what is extracted from it: None while that is being made, up to `share`."""

    acceptance: Acceptance
    extraction: Extraction | None
    share: float


@dataclass(frozen=True, slots=True)
class Discarded:
    """Says that the recording is in the trash."""

    discarded: bool


@router.get("/{log_id}")
def recording(
    log_id: str,
    parts: NeedsParts,
    nominal_impact_s: Seconds | None = None,
    from_s: Seconds | None = None,
    to_s: Seconds | None = None,
    tried: Annotated[
        bool, Query(description="with these three instead of what is kept, also where they are missing")
    ] = False,
    wait: Annotated[bool, Query(description="for the extraction, which takes as long as the recording")] = True,
) -> RecordingView:
    """Return what is decided about a recording and extracted from it, as if the impact and the window were as asked."""
    entry = recording_entry(parts, log_id)
    acceptance = load_acceptance(entry.path)
    asked = {"nominal_impact_s": nominal_impact_s, "from_s": from_s, "to_s": to_s}
    told = {key: value for key, value in asked.items() if tried or value is not None}
    question = _extraction(parts, entry, replace(acceptance, **told))
    if not (wait or question.done()):
        return RecordingView(acceptance, None, question.share)
    return RecordingView(acceptance, _EXTRACTION.validate_python(question.answer()), 1.0)


@router.post("/{log_id}")
def accept(log_id: str, acceptance: Acceptance, parts: NeedsParts) -> Acceptance:
    """Say what a recording is called, and whether it may be followed. An accepted one has to give a reference.

    It is kept then, and a rejected one has failed, unless it is discarded.
    """
    entry = recording_entry(parts, log_id)
    if acceptance.verdict is AcceptanceState.ACCEPTED:
        problem = _extraction(parts, entry, acceptance).answer()["problem"]
        if problem is not None:
            raise HTTPException(409, problem.replace(f"{entry.path}: ", ""))
    save_acceptance(entry.path, acceptance)
    remarks, verdict = load_remarks(entry.path), _VERDICTS.get(acceptance.verdict)
    if verdict is EpisodeVerdict.KEPT or (verdict and remarks.verdict in (None, EpisodeVerdict.KEPT)):
        save_remarks(entry.path, replace(remarks, verdict=verdict))
    return acceptance


def _extraction(parts: Parts, entry: LogEntry, acceptance: Acceptance) -> Question:
    """Ask what a recording gives: what a person has called it does not change that."""
    said = Acceptance(nominal_impact_s=acceptance.nominal_impact_s, from_s=acceptance.from_s, to_s=acceptance.to_s)
    return parts.questions.ask("extraction", entry.path, said)


@router.get("/{log_id}/thumbnail", response_class=Response, responses=file_of("image/svg+xml") | _NOT_YET)
def thumbnail(log_id: str, parts: NeedsParts) -> Response:
    """Draw the force on the pads over a recording, small: left blue, right orange."""
    read = opened(parts.catalogue, parts.review_cache, recording_entry(parts, log_id).id)
    if read is None or not read.index.done:
        return Response(status_code=202)
    return Response(forces_svg(read), media_type="image/svg+xml")


@router.post("/{log_id}/discard")
def discard(log_id: str, session: NeedsSession, parts: NeedsParts) -> Discarded:
    """Throw a recording away: it is moved to the trash, from where it comes back. Not the one that is being written."""
    entry = recording_entry(parts, log_id)
    if entry.path.name == written_now(parts):
        raise HTTPException(409, "it is being recorded; finish it first")
    throw_away(entry.path)
    return Discarded(True)


def recording_entry(parts: Parts, log_id: str) -> LogEntry:
    """Return the recording of an id. Raises Refused, HTTPException."""
    entry = listed(parts.catalogue, log_id, "there is no such recording; choose one from the list")
    if entry.kind not in RECORDINGS:
        raise HTTPException(404, "this log is no recording")
    return entry
