"""Jobs: a scripted demonstration or a trial, one at a time."""

from typing import Annotated

from fastapi import APIRouter
from fastapi.exceptions import HTTPException
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from console.log_rows import NoReference, reference_of
from console.parts import NeedsParts, NeedsSession, Parts
from console.preview import PreviewView
from console.queue.entry import TrialOrder
from console.routes.problems import problems
from console.routes.scene import plan_of
from rtstack.live.protocol import (
    DemonstrationRequest,
    GuideRequest,
    JobRequest,
    MoveRequest,
    ObjectName,
    Seed,
    Status,
    TeleoperationRequest,
)
from rtstack.log.catalogue import LogEntry
from rtstack.log.errors import LogError
from rtstack.messages import MESSAGE, NUMBER, StrictBool
from rtstack.trials.specification import HandMotion

router = APIRouter(prefix="/api/jobs", tags=["jobs"], responses=problems(409, 503))


@checked(frozen=True, slots=True, config=MESSAGE)
class DemonstrationOrder:
    """What the page asks for when it records a scripted demonstration."""

    object: ObjectName
    variation: Annotated[int, Field(ge=0, le=10_000), NUMBER] = 0
    seed: Seed = 0


@checked(frozen=True, slots=True, config=MESSAGE)
class TeleoperationOrder:
    """What the page asks for before it moves the arms by hand. See TeleoperationRequest."""

    object: ObjectName
    seed: Seed = 0
    recorded: StrictBool = False
    stop_on_release: StrictBool = True


@router.post("/teleoperation", status_code=202)
def teleoperation(order: TeleoperationOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Start a teleoperation: the arms hold where they are until the clutch is held."""
    request = TeleoperationRequest(
        order.object, order.seed, order.recorded, order.stop_on_release, operator=session.operator
    )
    return start_job(parts, request)


@router.post("/demonstration", status_code=202)
def demonstration(order: DemonstrationOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Start a scripted demonstration."""
    return start_job(parts, DemonstrationRequest(order.object, order.variation, order.seed, operator=session.operator))


@checked(frozen=True, slots=True, config=MESSAGE)
class MoveOrder:
    """What the page asks for when the arms are to move by themselves from where they are. See MoveRequest."""

    motion: HandMotion


@router.post("/move", status_code=202)
def move(order: MoveOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Go to the start, put down what is held, or open: on the cell as it is, under the judge."""
    return start_job(parts, MoveRequest(order.motion, operator=session.operator))


@router.post("/guide", status_code=202)
def guide(session: NeedsSession, parts: NeedsParts) -> Status:
    """Let a person push both arms while the clutch is held, in a fault too; hold it at once."""
    return start_job(parts, GuideRequest(operator=session.operator))


@router.post("/trial", status_code=202, responses=problems(404))
def trial(order: TrialOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Start a trial that follows a recording or a plan."""
    followed = followed_by(parts, order.reference)
    status = start_job(parts, order.request(followed.path, session.operator))
    if status.job is not None:
        parts.scenes.plans.ordered(status.job.number, plan_of(parts, order, order.object))
    return status


@router.post("/preview", status_code=202, responses=problems(404))
def begin_preview(order: TrialOrder, session: NeedsSession, parts: NeedsParts) -> PreviewView:
    """Simulate a trial, and show it in the scene as a ghost. No arm moves, and no control is needed."""
    status = parts.watch.view.status
    if status is not None and status.job is not None and status.job.active:
        raise HTTPException(409, "something moves: preview a trial while nothing does")
    return parts.preview.begin(order, followed_by(parts, order.reference).path)


@router.get("/preview")
def preview(parts: NeedsParts) -> PreviewView:
    """Return how far the newest preview is, and what came out."""
    return parts.preview.view


def followed_by(parts: Parts, log_id: str) -> LogEntry:
    """Return the recording or plan of an id. Raises HTTPException for what no trial may follow."""
    try:
        return reference_of(parts.catalogue, log_id)
    except NoReference as error:
        raise HTTPException(409, str(error)) from None
    except LogError:
        raise HTTPException(404, "there is no such recording or plan; choose one from the list") from None


def start_job(parts: Parts, request: JobRequest) -> Status:
    """Order a job and return the status that answers. Raises RobotRefused, RobotUnreachable."""
    status = parts.client.start(request)
    parts.watch.learn(status)
    return status
