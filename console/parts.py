"""What the console is made of, handed to every route: one frozen record instead of globals."""

from dataclasses import dataclass, field
from typing import Annotated

from fastapi import Depends, Request
from fastapi.requests import HTTPConnection

from console.calibration import CellCalibration
from console.campaigns.campaigns import Campaigns
from console.heartbeats import OperatorHeartbeats
from console.preview import Preview
from console.questions import Questions
from console.queue.queue import Queue
from console.review.cache import ReviewCache
from console.review.layouts import Layouts
from console.review.scene import ReviewScenes
from console.scenes import Scenes
from console.sign_in import SignIn, UserSession
from console.teleoperation.teleop_input import TeleopInput
from console.training.trainer import Trainer
from console.trials.impact import Impacts
from console.watch import Watch
from rtstack.live.audit import AuditTrail
from rtstack.live.client import RobotClient, RobotRefused
from rtstack.log.catalogue import Catalogue
from rtstack.loop.mailbox import Mailbox
from rtstack.model.cell_description import CellDescription


@dataclass(frozen=True, slots=True)
class Parts:
    """The console's parts. Their creator closes them. profile: of our simulated robot, "" for any other."""

    sign_in: SignIn
    audit: AuditTrail
    cell: CellDescription
    client: RobotClient
    mailbox: Mailbox
    heartbeats: OperatorHeartbeats
    watch: Watch
    catalogue: Catalogue
    scenes: Scenes
    teleop: TeleopInput
    review_cache: ReviewCache
    review_scenes: ReviewScenes
    queue: Queue
    campaigns: Campaigns
    preview: Preview
    trainer: Trainer
    questions: Questions
    layouts: Layouts
    calibration: CellCalibration
    profile: str = ""
    impacts: Impacts = field(default_factory=Impacts)


def parts_of(connection: HTTPConnection) -> Parts:
    """Return the parts of the application that serves this request or WebSocket."""
    return connection.app.state.parts


def written_now(parts: Parts) -> str | None:
    """Return the name of the log that the running job writes, None where none runs."""
    status = parts.watch.view.status
    job = None if status is None else status.job
    return job.log if job is not None and job.active else None


def session_now(connection: HTTPConnection) -> UserSession | None:
    """Return the session of a WebSocket as it is now: it may have ended, or got another name, since it was opened."""
    return parts_of(connection).sign_in.session(connection.scope["state"]["session"].key)


def _get_parts(request: Request) -> Parts:
    return parts_of(request)


def _get_session(request: Request) -> UserSession:
    return request.state.session  # the guard refuses these routes without one


def _get_holder(request: Request) -> UserSession:
    """Return the session that has control now, as the robot process says. Raises RobotRefused, RobotUnreachable."""
    session, holder = _get_session(request), parts_of(request).client.status().holder
    if holder != session.operator:
        raise RobotRefused(f"{holder or 'no operator'} has control; take control first")
    return session


NeedsHolder = Annotated[UserSession, Depends(_get_holder)]
NeedsSession = Annotated[UserSession, Depends(_get_session)]
NeedsParts = Annotated[Parts, Depends(_get_parts)]
