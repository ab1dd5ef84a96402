"""The queue of trials. What leads to motion needs the lease, pausing the scope `operate`; any STOP pauses it too."""

import time
from typing import Annotated

from fastapi import APIRouter, Path
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from console.parts import NeedsHolder, NeedsParts, NeedsSession, Parts, check_objects, takes_two_arms
from console.queue.entry import QueueOrder, QueueView, SweepOrder, SweepSize
from console.queue.queue import MAX_ENTRIES
from console.refused import Refused
from console.routes.control import request_stop
from console.routes.jobs import followed_by
from console.routes.problems import problems
from rtstack.live.client import RobotRefused
from rtstack.log_folder.log_rows import log_row
from rtstack.messages import MESSAGE, NUMBER, StrictBool

router = APIRouter(prefix="/api/queue", tags=["queue"], responses=problems(409, 500, 503))

EntryId = Annotated[str, Path(pattern="^[0-9a-f]{16}$")]
_TWO_ARMS = takes_two_arms("a queue of trials")


@checked(frozen=True, slots=True, config=MESSAGE)
class StartOrder:
    """How the queue is to run. past_failures: on past grabs that do not succeed, never past a fault or a stop."""

    past_failures: StrictBool = False


@checked(frozen=True, slots=True, config=MESSAGE)
class MoveOrder:
    """Where an entry is to be among those that wait: 0 is next."""

    to: Annotated[int, Field(ge=0, le=MAX_ENTRIES), NUMBER]


@checked(frozen=True, slots=True, config=MESSAGE)
class ClearOrder:
    """What is to be taken off the list: what is finished, or what waits too."""

    finished_only: StrictBool = True


@router.get("")
def queue(parts: NeedsParts) -> QueueView:
    """Return the entries in order, whether the queue runs and on whose word, and the time left."""
    return parts.queue.view()


@router.post("", status_code=201, responses=problems(404), dependencies=[_TWO_ARMS])
def add(order: QueueOrder, holder: NeedsHolder, parts: NeedsParts) -> QueueView:
    """Append a trial so many times, each with the next seed. Only the operator with control."""
    check_objects(parts, "object", order.trial.object)
    return parts.queue.add(order, _name_of(parts, order.trial.reference))


@router.post("/sweep", status_code=201, responses=problems(404, 422), dependencies=[_TWO_ARMS])
def sweep(order: SweepOrder, holder: NeedsHolder, parts: NeedsParts) -> QueueView:
    """Append a sweep: every combination of its objects, shifts, turns, seeds and controllers. All of it, or nothing.

    Only the operator with control.
    """
    trials = order.trials()
    check_objects(parts, "objects", *order.objects)
    return parts.queue.add_all(trials, _name_of(parts, order.reference))


@router.post("/sweep/size", responses=problems(422))
def sweep_size(order: SweepOrder, parts: NeedsParts) -> SweepSize:
    """Return how many trials a sweep would be, and how many the queue has room for. Changes nothing."""
    return SweepSize(len(order.trials()), parts.queue.room)


def _name_of(parts: Parts, reference: str) -> str:
    row = log_row(followed_by(parts, reference), None)
    made = time.strftime("%m-%d %H:%M:%S UTC", time.gmtime(row.when))
    return row.title or f"{row.kind} {(row.object or '').replace('_', ' ')}, {made}"


@router.post("/start", dependencies=[_TWO_ARMS])
def start(order: StartOrder, holder: NeedsHolder, parts: NeedsParts) -> QueueView:
    """Let the queue run on this operator's word. Only the operator with control, with armed arms."""
    status = parts.client.status()
    if status.refusal is not None and (status.job is None or not status.job.active):
        raise RobotRefused(status.refusal)
    parts.queue.start(holder.operator, order.past_failures)
    return parts.queue.view()


@router.post("/pause")
def pause(session: NeedsSession, parts: NeedsParts) -> QueueView:
    """Start nothing more; the trial that runs goes on to its end. Everybody who may operate: it needs no lease."""
    parts.queue.pause(f"{session.operator} paused it")
    return parts.queue.view()


@router.post("/cancel")
async def cancel_running(session: NeedsSession, parts: NeedsParts) -> QueueView:
    """Pause the queue and stop its trial that runs, as STOP does. Everybody who may operate: it needs no lease."""
    parts.queue.pause(f"{session.operator} cancelled the trial that ran")
    if parts.queue.running() is None:
        raise Refused(409, "no trial of the queue is running")
    await request_stop(parts, session)
    return parts.queue.view()


@router.post("/clear")
def clear(order: ClearOrder, holder: NeedsHolder, parts: NeedsParts) -> QueueView:
    """Take what is finished off the list, or everything but what runs. Only the operator with control."""
    return parts.queue.clear(order.finished_only)


@router.post("/{entry_id}/move", responses=problems(404))
def move(entry_id: EntryId, order: MoveOrder, holder: NeedsHolder, parts: NeedsParts) -> QueueView:
    """Move an entry that waits. Only the operator with control."""
    return parts.queue.move(entry_id, order.to)


@router.post("/{entry_id}/remove", responses=problems(404))
def remove(entry_id: EntryId, holder: NeedsHolder, parts: NeedsParts) -> QueueView:
    """Take an entry that does not run off the list. Only the operator with control."""
    return parts.queue.remove(entry_id)


@router.post("/{entry_id}/cancel", responses=problems(404))
def cancel(entry_id: EntryId, holder: NeedsHolder, parts: NeedsParts) -> QueueView:
    """Cancel an entry that waits; it stays in the list. Only the operator with control."""
    return parts.queue.cancel(entry_id)
