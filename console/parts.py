"""What the console is made of, handed to every route: one frozen record instead of globals."""

from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

from fastapi import Depends, Request
from fastapi.requests import HTTPConnection

from console.address import Address
from console.calibration import CellCalibration
from console.campaigns.campaigns import Campaigns
from console.live.control_request import ControlRequest
from console.live.heartbeats import OperatorHeartbeats
from console.live.watch import STATUS_TIMEOUT_S, Watch
from console.panels import Panels
from console.questions.questions import Questions
from console.queue.queue import FILE_NAME as QUEUE_FILE
from console.queue.queue import Queue
from console.queue.runner import QueueRunner
from console.refused import Refused
from console.review.cache import ReviewCache
from console.review.layouts import Layouts
from console.review.scene import ReviewScenes
from console.scene.ghost import GhostPlayer
from console.scene.preview import Planner, Preview
from console.scene.scenes import Scenes
from console.session_file import SessionFile
from console.sign_in import SignIn, UserSession
from console.teleoperation.teleop_input import TeleopInput
from console.training.trainer import Trainer
from rtstack.access.tokens import Tokens
from rtstack.live.audit import FILE_NAME as AUDIT_FILE
from rtstack.live.audit import AuditTrail
from rtstack.live.client import RobotClient, RobotRefused
from rtstack.log.ring import Rings
from rtstack.log_folder.catalogue import Catalogue
from rtstack.loop.mailbox import Mailbox
from rtstack.model.cell_description import CellDescription
from rtstack.trials.object import check_two_arms

Closed = TypeVar("Closed", bound=Any)  # something with a method `close`


@dataclass(frozen=True, slots=True)
class Parts:
    """The console's parts. `assemble` makes them. profile: of our simulated robot, "" for any other."""

    sign_in: SignIn
    audit: AuditTrail
    cell: CellDescription
    client: RobotClient
    mailbox: Mailbox
    heartbeats: OperatorHeartbeats
    request: ControlRequest
    watch: Watch
    catalogue: Catalogue
    scenes: Scenes
    teleop: TeleopInput
    review_cache: ReviewCache
    review_scenes: ReviewScenes
    queue: Queue
    campaigns: Campaigns
    preview: Preview
    planner: Planner
    trainer: Trainer
    questions: Questions
    layouts: Layouts
    calibration: CellCalibration
    panels: Panels
    profile: str = ""


def assemble(
    stack: ExitStack, address: Address, cell: CellDescription, cell_file: Path, logs: Path, socket_path: Path,
    mailbox: Mailbox, rings: Rings, profile: str = "", patience_s: float = STATUS_TIMEOUT_S,
) -> Parts:  # fmt: skip
    """Make the parts, which the stack closes, and watch. patience_s: for the status. Raises Refused, OSError."""

    def kept(part: Closed) -> Closed:
        return stack.enter_context(closing(part))

    audit = kept(AuditTrail(logs / AUDIT_FILE))
    client, heartbeats, catalogue = kept(RobotClient(socket_path)), OperatorHeartbeats(), Catalogue(logs)
    watch = kept(Watch(rings, kept(RobotClient(socket_path, patience_s)), heartbeats, cell))
    teleop, ghost, questions = TeleopInput(mailbox, watch), GhostPlayer(logs), kept(Questions(cell))
    queue = Queue(logs / QUEUE_FILE)
    kept(QueueRunner(queue, kept(RobotClient(socket_path, patience_s)), catalogue, watch.learn))
    return Parts(
        sign_in=SignIn(address, Tokens(logs), audit, SessionFile(logs)),
        audit=audit,
        cell=cell,
        client=client,
        mailbox=mailbox,
        heartbeats=heartbeats,
        request=ControlRequest(),
        watch=watch,
        catalogue=catalogue,
        scenes=kept(Scenes(cell, watch, teleop, questions, ghost)),
        teleop=teleop,
        review_cache=kept(ReviewCache(logs)),
        review_scenes=kept(ReviewScenes(cell)),
        queue=queue,
        campaigns=kept(Campaigns(logs, socket_path)),
        preview=kept(Preview(cell_file, ghost, profile)),
        planner=kept(Planner(cell_file, ghost, logs)),
        trainer=kept(Trainer(watch)),
        questions=questions,
        layouts=Layouts(logs),
        calibration=CellCalibration(cell_file, logs, questions, watch),
        panels=kept(Panels(logs, watch)),
        profile=profile,
    )


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


def _get_session(request: Request) -> UserSession:
    return request.state.session  # the guard refuses these routes without one


def _get_holder(request: Request) -> UserSession:
    """Return the session that has control now, as the robot process says. Raises RobotRefused, RobotUnreachable."""
    session, holder = _get_session(request), parts_of(request).client.status().holder
    if holder != session.operator:
        raise RobotRefused(f"{holder or 'no operator'} has control; take control first")
    return session


def check_objects(parts: Parts, field: str, *names: str) -> None:
    """Raise Refused where the cell lacks one of these objects. field: of the request, which has their names."""
    for name in names:
        if name not in parts.cell.objects:
            raise Refused(409, f"{field}: the cell has no {name}; it has {', '.join(parts.cell.objects)}")


def takes_two_arms(what: str) -> Any:
    """Return a route's dependency that raises TrialError for `what` in a cell with one arm."""

    def check(request: Request) -> None:
        check_two_arms(parts_of(request).cell, what)

    return Depends(check)


NeedsHolder = Annotated[UserSession, Depends(_get_holder)]
NeedsSession = Annotated[UserSession, Depends(_get_session)]
NeedsParts = Annotated[Parts, Depends(parts_of)]
