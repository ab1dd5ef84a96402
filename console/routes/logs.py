"""Logs: the list with its search, the download, and what the review asks of one log. All by opaque ids."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query
from fastapi.exceptions import HTTPException
from fastapi.responses import FileResponse, Response, StreamingResponse

from console.parts import NeedsParts, Parts, written_now
from console.review import logs as reviewed
from console.review.columns import Index, Mark
from console.review.figure import MEDIA_TYPES, drawn_logs, figure_file, overlays_of
from console.review.series import Tabled, Window, csv_lines, curves, difference_curves, moment, packed
from console.routes.problems import attachment, file_of, problems
from rtstack.figures.log_data import with_references
from rtstack.log.analysis.lateness import lateness_of
from rtstack.log.analysis.offered import Analysed
from rtstack.log.analysis.signals import Signal, signals
from rtstack.log.reader import Log, read_log
from rtstack.log.time_of_day import time_of_day
from rtstack.log_folder.catalogue import LogCondition
from rtstack.log_folder.difference import differences
from rtstack.log_folder.log_rows import LogRow, log_row
from rtstack.log_folder.search import Outcome, SortKey, ordered, search
from rtstack.samples import Level
from rtstack.trials.specification import like

router = APIRouter(prefix="/api/logs", tags=["logs"], responses=problems(500))

_OF_A_LOG = problems(404, 409)
_BYTES = "application/octet-stream"

Seconds = Annotated[float, Query(ge=-1e9, le=1e9, allow_inf_nan=False)]
Names = Annotated[str, Query(max_length=8192)]
Other = Annotated[str, Query(max_length=128)]
LevelName = Literal["DEBUG", "INFO", "WARNING", "ERROR", "FATAL"]
Width = Annotated[int, Query(ge=16, le=8192)]


def _log(parts: Parts, log_id: str) -> reviewed.ReadLog:
    return reviewed.begun(parts.catalogue, parts.review_cache, log_id)


def _file(parts: Parts, log_id: str) -> Log:
    return read_log(reviewed.entry_of(parts.catalogue, log_id).path, truncated=True)


@dataclass(frozen=True, slots=True)
class LogReview:
    """A log as far as it has been read. trial and result: its metadata; topics: samples of each.

    share: how much of it, 0 to 1; start_ns: of its first sample; recorded: when it began, UTC, ISO 8601;
    modes: (from s, to s, mode) of each side; analyses: what those of installed packages say, once all has been read.
    Nothing is in it of an arm that the log does not have.
    """

    row: LogRow
    trial: dict[str, str] | None
    result: dict[str, str] | None
    condition: LogCondition
    share: float
    done: bool
    start_ns: str | None
    recorded: str | None
    duration_s: float | None
    topics: dict[str, int]
    modes: dict[str, list[tuple[float, float, str]]]
    events: list[Mark]
    analyses: list[Analysed]


@dataclass(frozen=True, slots=True)
class ValuesAt:
    """What a log says about a moment: see console.review.series.Moment. q: of the arms that the log has."""

    t_s: float
    values: dict[str, float | None]
    q: list[list[float]] | None
    object: list[float] | None


@dataclass(frozen=True, slots=True)
class Difference:
    """One setting that two logs do not share; None where a log does not have it."""

    key: str
    this: str | None
    other: str | None


@dataclass(frozen=True, slots=True)
class LatenessOf:
    """Who was late: cycles, late, stalls, shares, causes, the worst and a line, as `rtstack review --json` has them."""

    lateness: dict[str, Any] | None


@dataclass(frozen=True, slots=True)
class PicturesOf:
    """When each camera of a log has a picture, s after the log's first sample, by the camera's name."""

    cameras: dict[str, list[float]]


@router.get("", responses=problems(422))
def logs(
    parts: NeedsParts,
    q: Annotated[str, Query(max_length=400)] = "",
    kind: Annotated[str, Query(max_length=40)] = "",
    outcome: Outcome = Outcome.ANY,
    sort: SortKey = SortKey.WHEN,
    descending: bool = True,
) -> list[LogRow]:
    """Return the logs that have every word of `q` somewhere in what is known of them, the newest first.

    A word such as force>30 or seed<=4 asks for a number in a range.
    """
    being_written = written_now(parts)
    pairs = [(entry, log_row(entry, being_written)) for entry in parts.catalogue.entries()]
    return ordered(search([pair for pair in pairs if kind in ("", pair[1].kind)], q, outcome), sort, descending)


@router.get("/signals")
def signal_tree() -> list[Signal]:
    """Return every signal that a log can have: name, topic, group, field, component, unit."""
    return list(signals().values())


@router.get("/{log_id}", responses=_OF_A_LOG)
def log(log_id: str, parts: NeedsParts) -> LogReview:
    """Return a log's row, metadata, modes and events, and how far it has been read: `share`, 0 to 1.

    The first request has the log read, in a process of its own.
    """
    entry = reviewed.entry_of(parts.catalogue, log_id)
    read = reviewed.opened_entry(entry, parts.review_cache)
    index = Index(0, 0.0, {}) if read is None else read.index
    return like(
        LogReview,
        index,
        row=log_row(entry, written_now(parts)),
        trial=None if entry.trial is None else dict(entry.trial),
        result=None if entry.result is None else dict(entry.result),
        condition=entry.condition,
        start_ns=None if read is None else str(index.start_ns),  # beyond what a browser's numbers can hold
        recorded=entry.recorded,
        duration_s=None if read is None else index.duration_s,
        topics=index.rows,
    )


@router.get("/{log_id}/events", responses=_OF_A_LOG)
def events(log_id: str, parts: NeedsParts, level: LevelName = "DEBUG") -> list[Mark]:
    """Return a log's events of this severity or a higher one, in order of time."""
    return [mark for mark in _log(parts, log_id).index.events if Level[mark.level] >= Level[level]]


@router.get("/{log_id}/series", response_class=Response, responses=_OF_A_LOG | file_of(_BYTES))
def series(
    log_id: str, parts: NeedsParts, signals: Names, start: Seconds, end: Seconds, width: Width = 1000,
    other: Other = "", offset: Seconds = 0.0,
) -> Response:  # fmt: skip
    """Return curves in binary form. Times s after the log's first sample. other: a log of which the signals' difference
    to this one is wanted, its time moved by offset.

    Little-endian: the length of a header (uint32), the header as JSON (topic, signals, bucket, points of each group),
    then for each group its times (float64) and for each of its signals the values (float32), twice, smallest and
    largest, where a bucket has more than one sample. Header and arrays start at multiples of eight bytes.
    """
    read, *others = (_log(parts, one) for one in (log_id, other) if one)
    wanted = reviewed.wanted_signals(signals, read, *others)
    if not start < end:
        raise HTTPException(422, "start: has to be before `end`")
    window = Window(start, end, width)
    found = difference_curves(read, others[0], wanted, window, offset) if others else curves(read, wanted, window)
    return Response(packed(found), media_type=_BYTES)


@router.get("/{log_id}/values", responses=_OF_A_LOG)
def values(log_id: str, parts: NeedsParts, t: Seconds, signals: Names = "") -> ValuesAt:
    """Return the newest samples at a moment: values of signals, joints of the arms, the object's pose."""
    read = _log(parts, log_id)
    found = moment(read, reviewed.wanted_signals(signals, read), t)
    q, place = (None if numbers is None else numbers.tolist() for numbers in (found.q, found.object))
    return ValuesAt(found.t_s, found.values, q, place)


@router.get("/{log_id}/csv", response_class=StreamingResponse, responses=_OF_A_LOG | file_of("text/csv"))
def csv(
    log_id: str, parts: NeedsParts, signals: Names, start: Seconds, end: Seconds, other: Other = "",
    offset: Seconds = 0.0,
) -> StreamingResponse:  # fmt: skip
    """Send every sample of the signals in a window as a table. other: a compared log, whose time is moved by offset."""
    read, *others = (_log(parts, one) for one in (log_id, other) if one)
    wanted = reviewed.wanted_signals(signals, read, *others)
    tabled = [Tabled(read, time=time_of_day(read_log(read.entry.path, truncated=True)))]
    tabled += [Tabled(each, "other.", offset) for each in others]
    table = csv_lines(tabled, wanted, start, end)
    return StreamingResponse(table, media_type="text/csv", headers=attachment(f"{read.entry.path.stem}.csv"))


@router.get("/{log_id}/figure", response_class=Response, responses=_OF_A_LOG | file_of(*MEDIA_TYPES.values()))
def figure(
    log_id: str, parts: NeedsParts, signals: Names, start: Seconds, end: Seconds,
    form: Literal["pdf", "svg", "png"] = "pdf",
    others: Annotated[str, Query(max_length=1024, description="ID:OFFSET of other logs, with commas between")] = "",
    reference: bool = False, difference: bool = False,
) -> Response:  # fmt: skip
    """Draw signals in a window as a figure in the papers' style, up to five other logs over them, or their difference.

    reference: with what the signals are to follow. offset: what is added to another log's time, s.
    """
    read = _log(parts, log_id)
    overlays = [(_log(parts, other), offset_s) for other, offset_s in overlays_of(others)]
    if not (wanted := reviewed.wanted_signals(signals, read, *(other for other, _ in overlays))):
        raise HTTPException(422, "signals: name one at least")
    if not start < end:
        raise HTTPException(422, "start: has to be before `end`")
    if difference and not overlays:
        raise HTTPException(422, "others: a difference needs another log")
    drawn = drawn_logs(read, overlays, with_references(wanted) if reference else wanted, start, end, difference)
    drawing = figure_file(drawn, start, end, drawn[0].name if difference else read.entry.path.name, form)
    return Response(drawing, media_type=MEDIA_TYPES[form], headers=attachment(f"{read.entry.path.stem}.{form}"))


@router.get("/{log_id}/difference", responses=_OF_A_LOG)
def difference(log_id: str, other: str, parts: NeedsParts) -> list[Difference]:
    """Return what was set differently for two logs: metadata, cell, parameters."""
    return [Difference(key, *values) for key, values in differences([_file(parts, one) for one in (log_id, other)])]


@router.get("/{log_id}/lateness", responses=_OF_A_LOG)
def late_cycles(log_id: str, parts: NeedsParts) -> LatenessOf:
    """Return who was late in a log, and the longest stalls; null where its arms had no clocks of their own."""
    found = lateness_of(_file(parts, log_id))
    return LatenessOf(None if found is None else found.as_dict())


@router.get("/{log_id}/cameras", responses=_OF_A_LOG)
def cameras(log_id: str, parts: NeedsParts) -> PicturesOf:
    """Return when each camera of a log has a picture."""
    read = _log(parts, log_id)
    return PicturesOf(reviewed.picture_times(read.entry, read.index.start_ns))


@router.get("/{log_id}/cameras/{camera}", response_class=Response, responses=_OF_A_LOG | file_of("image/jpeg"))
def picture(log_id: str, camera: str, t: Seconds, parts: NeedsParts) -> Response:
    """Send the newest picture of a camera at a moment, s after the log's first sample."""
    read = _log(parts, log_id)
    data = reviewed.picture_at(read.entry, camera, read.index.start_ns + round(t * 1e9))
    if data is None:
        raise HTTPException(404, "the log has no such camera; /api/logs/ID/cameras names them")
    return Response(data, media_type="image/jpeg", headers={"cache-control": "private, max-age=3600"})


@router.get("/{log_id}/download", response_class=FileResponse, responses=_OF_A_LOG | file_of(_BYTES))
def download(log_id: str, parts: NeedsParts) -> FileResponse:
    """Send the file of a log."""
    path = reviewed.listed(parts.catalogue, log_id).path
    return FileResponse(path, media_type=_BYTES, filename=path.name)
