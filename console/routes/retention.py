"""What people do with logs: star, tag, note, delete, and bring back. Nothing that is in use is deleted."""

import time
from dataclasses import dataclass, replace
from typing import Annotated

from fastapi import APIRouter, Body, Path
from fastapi.exceptions import HTTPException

from console.parts import NeedsParts, NeedsSession, Parts, written_now
from console.queue.entry import EntryState
from console.refused import Refused
from console.review.logs import growing, listed
from console.routes.problems import problems
from rtstack.log.errors import LogError
from rtstack.log_folder import trash
from rtstack.log_folder.catalogue import LogEntry
from rtstack.log_folder.log_rows import RECORDINGS, LogRow, log_row
from rtstack.log_folder.remarks import Note, Remarks, load_notes, save_notes, save_remarks
from rtstack.log_folder.trash import Trashed
from rtstack.references.acceptance import AcceptanceState, load_acceptance, save_acceptance

router = APIRouter(prefix="/api", tags=["logs"], responses=problems(500))

TrashId = Annotated[str, Path(pattern="^[0-9a-f]{16}$")]


@dataclass(frozen=True, slots=True)
class Trash:
    """What was deleted, the newest first. It is kept for so many days, then `rtstack logs prune` removes it."""

    logs: tuple[Trashed, ...]
    size_bytes: int
    kept_days: float


@router.post("/logs/{log_id}/remarks", responses=problems(404))
def remark(log_id: str, remarks: Remarks, parts: NeedsParts) -> LogRow:
    """Say something about a log: star, tags, note, in the place of what was said before. Everybody who may operate."""
    entry = listed(parts.catalogue, log_id)
    if entry.kind in RECORDINGS:  # its note is where it is accepted: one note a log
        save_acceptance(entry.path, replace(load_acceptance(entry.path), note=remarks.note))
        remarks = replace(remarks, note="")
    save_remarks(entry.path, replace(remarks, tags=tuple(dict.fromkeys(remarks.tags))))
    return log_row(entry, written_now(parts))


@router.get("/logs/{log_id}/notes", responses=problems(404))
def notes(log_id: str, parts: NeedsParts) -> list[Note]:
    """Return the notes at times of a log. t_s: s after its first sample."""
    return load_notes(listed(parts.catalogue, log_id).path)


@router.post("/logs/{log_id}/notes", responses=problems(404))
def write_notes(log_id: str, notes: Annotated[list[Note], Body(max_length=500)], parts: NeedsParts) -> list[Note]:
    """Keep these notes at times of a log, beside it, in the place of those before."""
    save_notes(listed(parts.catalogue, log_id).path, notes)
    return notes


@router.post("/logs/{log_id}/delete", responses=problems(404, 409))
def delete(log_id: str, session: NeedsSession, parts: NeedsParts) -> Trashed:
    """Move a log to the trash. Refused while it is written or read, waits in the queue, or is an accepted reference."""
    entry = listed(parts.catalogue, log_id)
    _check_unused(parts, entry)
    parts.review_cache.forget(entry)
    deleted = trash.delete(entry.path)
    parts.audit.note("delete", session.operator, f"{session.operator} deleted {entry.path.name}")
    return deleted


@router.get("/trash")
def trashed(parts: NeedsParts) -> Trash:
    """Return the deleted logs that can be brought back."""
    found = tuple(trash.trashed(parts.catalogue.directory))
    return Trash(found, sum(each.size_bytes for each in found), trash.KEPT_DAYS)


@router.post("/trash/{trash_id}/restore", responses=problems(404, 409))
def restore(trash_id: TrashId, session: NeedsSession, parts: NeedsParts) -> LogRow:
    """Bring a deleted log back, with what was said about it."""
    if trash_id not in [each.id for each in trash.trashed(parts.catalogue.directory)]:
        raise HTTPException(404, "it is not in the trash: it was brought back, or removed for good")
    try:
        name = trash.restore(parts.catalogue.directory, trash_id)
    except LogError as error:
        raise HTTPException(409, str(error)) from None
    parts.audit.note("restore", session.operator, f"{session.operator} brought {name} back")
    for entry in parts.catalogue.entries():
        if entry.path.name == name:
            return log_row(entry, None)
    raise HTTPException(404, "it was removed meanwhile")


@router.post("/trash/empty")
def empty(session: NeedsSession, parts: NeedsParts) -> Trash:
    """Remove all deleted logs for good."""
    parts.audit.note("empty trash", session.operator, f"{session.operator} removed the deleted logs for good")
    trash.empty(parts.catalogue.directory, time.time())
    return trashed(parts)


def _check_unused(parts: Parts, entry: LogEntry) -> None:
    """Raise Refused where a log cannot be deleted now."""
    if growing(entry) or entry.path.name == written_now(parts):
        raise Refused(409, "it is being written: wait until its run has ended")
    if parts.review_cache.being_read(entry):
        raise Refused(409, "it is being read for the review: wait until that has ended")
    open_states = (EntryState.WAITING, EntryState.RUNNING)
    if any(each.trial.reference == entry.id and each.state in open_states for each in parts.queue.view().entries):
        raise Refused(409, "trials in the queue follow it: remove them first")
    if entry.kind in RECORDINGS and load_acceptance(entry.path).verdict is AcceptanceState.ACCEPTED:
        raise Refused(409, "it is an accepted reference: reject it first, on its page")
