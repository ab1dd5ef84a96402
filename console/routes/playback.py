"""Playback on the arms: a log of the list, at a speed of its own, with a soft stop besides STOP."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter
from fastapi.exceptions import HTTPException
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from console.log_rows import log_path
from console.parts import NeedsParts, NeedsSession
from console.questions import Refused
from console.routes.jobs import start_job
from console.routes.problems import problems
from rtstack.live.protocol import PlaybackRequest, Seed, Status
from rtstack.messages import MESSAGE, StrictFloat
from rtstack.playback.pace import FASTEST, SLOWEST

router = APIRouter(prefix="/api", tags=["jobs"], responses=problems(409, 503))


@checked(frozen=True, slots=True, config=MESSAGE)
class PlaybackOrder:
    """What the page asks for when it plays a log on the arms. `log` is its id, speed times the log's own."""

    log: Annotated[str, Field(min_length=1, max_length=128)]
    speed: Annotated[StrictFloat, Field(ge=SLOWEST, le=FASTEST)] = 1.0
    seed: Seed = 0


@dataclass(frozen=True, slots=True)
class Finishing:
    """Says that the wish for a soft stop has reached the loop's memory."""

    finishing: bool


@router.post("/jobs/playback", status_code=202, responses=problems(404))
def playback(order: PlaybackOrder, session: NeedsSession, parts: NeedsParts) -> Status:
    """Start playing a log. What its path asks of the arms at this speed is looked at before they move."""
    path = log_path(parts.catalogue, order.log)
    if path is None:
        raise HTTPException(404, "there is no such log; choose one from the list")
    return start_job(parts, PlaybackRequest(str(path), order.speed, order.seed, operator=session.operator))


@dataclass(frozen=True, slots=True)
class PlaybackLimit:
    """The largest speed at which a log may be played, times its own, or why it cannot be; neither: not known yet."""

    fastest: float | None
    refused: str | None


@router.get("/logs/{log_id}/playback", responses=problems(404))
def limit(log_id: str, parts: NeedsParts) -> PlaybackLimit:
    """Say how fast a log may be played on the arms. The first answers have neither: it is being computed."""
    path = log_path(parts.catalogue, log_id)
    if path is None:
        raise HTTPException(404, "there is no such log; choose one from the list")
    question = parts.questions.ask("fastest", path)
    if not question.done:
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
