"""Jobs, one at a time: what moves the arms, by hand or by itself, with a soft stop of a playback besides STOP."""

from dataclasses import dataclass

from fastapi import APIRouter
from fastapi.exceptions import HTTPException

from console.orders import DemonstrationOrder, MoveOrder, PlanOrder, PlaybackOrder, TeleoperationOrder, TrialOrder
from console.parts import NeedsParts, NeedsSession, Parts, check_objects, takes_two_arms
from console.refused import Refused
from console.review.logs import listed
from console.routes.problems import problems
from console.routes.scene import plan_of
from console.scene.preview import PreviewView
from console.sign_in import UserSession
from rtstack.live.protocol import JobSpecification, RunRequest, Status
from rtstack.log.errors import LogError
from rtstack.log_folder.catalogue import LogEntry
from rtstack.log_folder.log_rows import reference_of
from rtstack.trials.specification import GuideSpecification, PlaybackSpecification, TrialSpecification, like

router = APIRouter(prefix="/api", tags=["jobs"], responses=problems(409, 503))

_TWO_ARMS = takes_two_arms("a trial of a grab")
_NO_LOG = "there is no such log; choose one from the list"


@dataclass(frozen=True, slots=True)
class Finishing:
    """Says that the wish for a soft stop has reached the loop's memory."""

    finishing: bool


@dataclass(frozen=True, slots=True)
class PlaybackLimit:
    """The largest speed at which a log may be played, times its own, or why it cannot be; neither: not known yet."""

    fastest: float | None
    refused: str | None


@dataclass(frozen=True, slots=True)
class KeptPlan:
    """id: of the plan's log."""

    id: str


@router.post("/jobs/teleoperation", status_code=202)
def teleoperation(order: TeleoperationOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Start a teleoperation: the arms hold where they are until the clutch is held."""
    return start_job(parts, order, session)


@router.post("/jobs/demonstration", status_code=202)
def demonstration(order: DemonstrationOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Start a scripted demonstration."""
    return start_job(parts, order, session)


@router.post("/jobs/move", status_code=202)
def move(order: MoveOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Go to the start, put down what is held, or open: on the cell as it is, under the judge."""
    return start_job(parts, order, session)


@router.post("/jobs/guide", status_code=202)
def guide(session: NeedsSession, parts: NeedsParts) -> Status:
    """Let a person push the arms while the clutch is held, in a fault too; hold it at once."""
    return start_job(parts, GuideSpecification(), session)


@router.post("/jobs/trial", status_code=202, responses=problems(404))
def trial(order: TrialOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Start a trial that follows a recording or a plan."""
    followed = followed_by(parts, order.reference)
    status = start_job(parts, like(TrialSpecification, order, reference=str(followed.path)), session)
    if status.job is not None:
        parts.scenes.plans.ordered(status.job.number, plan_of(parts, order, order.object))
    return status


@router.post("/jobs/preview", status_code=202, responses=problems(404), dependencies=[_TWO_ARMS])
def begin_preview(order: TrialOrder, session: NeedsSession, parts: NeedsParts) -> PreviewView:
    """Simulate a trial, and show it in the scene as a ghost. No arm moves, and no control is needed."""
    status = parts.watch.view.status
    if status is not None and status.job is not None and status.job.active:
        raise HTTPException(409, "something moves: preview a trial while nothing does")
    return parts.preview.begin(order, followed_by(parts, order.reference).path)


@router.get("/jobs/preview")
def preview(parts: NeedsParts) -> PreviewView:
    """Return how far the newest preview is, and what came out."""
    return parts.preview.view


@router.post("/planned", status_code=202, dependencies=[_TWO_ARMS])
def plan(order: PlanOrder, session: NeedsSession, parts: NeedsParts) -> PreviewView:
    """Plan a grab without a demonstration, and show it in the scene as a ghost. No arm moves, no control is needed."""
    check_objects(parts, "object", order.object)
    return parts.planner.plan(order)


@router.get("/planned")
def planned(parts: NeedsParts) -> PreviewView:
    """Return how far the newest plan is, and what came out."""
    return parts.planner.view


@router.delete("/planned")
def cancel_plan(session: NeedsSession, parts: NeedsParts) -> PreviewView:
    """Give up what is being planned."""
    parts.planner.close()
    return parts.planner.view


@router.post("/planned/reference", status_code=201)
def use_plan(session: NeedsSession, parts: NeedsParts) -> KeptPlan:
    """Put the newest plan among the logs, as what a trial may follow; return its id."""
    path = parts.planner.keep()
    return KeptPlan(next((entry.id for entry in parts.catalogue.entries() if entry.path == path), ""))


@router.post("/jobs/playback", status_code=202, responses=problems(404))
def playback(order: PlaybackOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Start playing a log. What its path asks of the arms at this speed is looked at before they move."""
    log = listed(parts.catalogue, order.source, _NO_LOG)
    return start_job(parts, like(PlaybackSpecification, order, source=str(log.path)), session)


@router.get("/logs/{log_id}/playback", responses=problems(404))
def limit(log_id: str, parts: NeedsParts) -> PlaybackLimit:
    """Say how fast a log may be played on the arms. The first answers have neither: it is being computed."""
    question = parts.questions.ask("fastest", listed(parts.catalogue, log_id, _NO_LOG).path)
    if not question.done():
        return PlaybackLimit(None, None)
    try:
        return PlaybackLimit(question.answer(), None)
    except Refused as error:
        return PlaybackLimit(None, str(error))


@router.post("/playback/finish")
def finish(session: NeedsSession, parts: NeedsParts) -> Finishing:
    """Brake along the path, to rest. STOP is quicker."""
    parts.teleop.finish(session.operator)
    return Finishing(True)


def followed_by(parts: Parts, log_id: str) -> LogEntry:
    """Return the recording or plan of an id. Raises HTTPException, NoReference for what no trial may follow."""
    try:
        return reference_of(parts.catalogue, log_id)
    except LogError:
        raise HTTPException(404, "there is no such recording or plan; choose one from the list") from None


def start_job(parts: Parts, asked: JobSpecification, session: UserSession, faults: str = "") -> Status:
    """Ask for a run and return the status that answers. Raises RobotRefused, RobotUnreachable."""
    return parts.watch.learn(parts.client.start(RunRequest(asked, session.operator, faults)))
