"""Teleoperation: a WebSocket and plain requests, for programs and pages alike (docs/howto/teleoperation.md)."""

import asyncio
import contextlib
import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from console.parts import NeedsParts, NeedsSession, Parts, parts_of, session_now
from console.routes.control import request_stop
from console.routes.problems import problems
from console.routes.sockets import SIGNED_OUT
from console.sign_in import UserSession
from console.teleoperation.devices import Coupling, OfArms
from console.teleoperation.teleop_view import Handles, Lead, TeleopView
from rtstack.live.client import RobotRefused, RobotUnreachable
from rtstack.live.protocol import NoteRequest
from rtstack.loop.mailbox import Release
from rtstack.messages import MESSAGE, StrictBool, StrictFloat, problem
from rtstack.samples import SIDES
from rtstack.teleoperation.reach import FASTEST_M_S, HARDEST_N_M, SLOWEST_M_S, SOFTEST_N_M
from rtstack.teleoperation.stamp import Stamp

router = APIRouter(prefix="/api/teleoperation", tags=["teleoperation"], responses=problems(409))

_Pose = Annotated[list[Annotated[StrictFloat, Field(ge=-10.0, le=10.0)]], Field(min_length=7, max_length=7)]
_Deflection = Annotated[list[Annotated[StrictFloat, Field(ge=-1.0, le=1.0)]], Field(min_length=6, max_length=6)]


@checked(frozen=True, slots=True, config=MESSAGE)
class PadPoses:
    """A pose for each arm that the cell has, or for one: position, m, and quaternion wxyz, in the world (7 numbers)."""

    left: _Pose | None = None
    right: _Pose | None = None


@checked(frozen=True, slots=True, config=MESSAGE)
class Deflections:
    """A deflection for each arm of the cell, or for one: along and about the world's axes, -1 to 1 of the speed."""

    left: _Deflection | None = None
    right: _Deflection | None = None


@checked(frozen=True, slots=True, config=MESSAGE)
class TeleopMessage:
    """One message of an input device."""

    clutch: StrictBool | None = None
    lost: StrictBool = False
    coupling: Coupling | None = None
    speed_m_s: Annotated[StrictFloat, Field(ge=SLOWEST_M_S, le=FASTEST_M_S)] | None = None
    stiffness_n_m: Annotated[StrictFloat, Field(ge=SOFTEST_N_M, le=HARDEST_N_M)] | None = None
    pose: PadPoses | None = None
    hands: PadPoses | None = None
    sensed: PadPoses | None = None  # from which `hands`, `pose` or `deflection` are made by a filter or a scale
    tracked: StrictBool = True  # false: a hand is not seen, whatever its pose is
    deflection: Deflections | None = None
    grip: StrictBool = False
    handles: Handles | None = None
    lead: Lead | None = None
    sent: StrictFloat | None = None  # comes back, so that a page can tell how long a beat takes
    stamp: Stamp | None = None
    stop: StrictBool = False
    failed: Annotated[str, Field(max_length=400)] = ""  # the device has ended so; the run that goes on has failed


_OF_HANDS = (("hands",), ("pose",), ("sensed",))
_MESSAGES = TypeAdapter(TeleopMessage)
_MOST_WAITING = 1000  # a sender that is so much faster than the console has lost the hand


@router.get("/hand")
def look(parts: NeedsParts) -> TeleopView:
    """Return how the hand is; the next command answers the picture that this brings."""
    return parts.teleop.view


@router.post("/hand")
async def request(message: TeleopMessage, session: NeedsSession, parts: NeedsParts) -> TeleopView:
    """Do what a message says, once. The clutch goes quiet unless it is said again."""
    # not async for waiting: in the event loop, as those of sockets are, no message is carried out within another one
    if message.stop:
        await request_stop(parts, session)
    await _note(parts, session.operator, message.failed)
    _act(parts, session.operator, message)
    return parts.teleop.view


@router.post("/finish")
def finish(session: NeedsSession, parts: NeedsParts) -> TeleopView:
    """End the teleoperation: the arms stop, and the log is finished."""
    parts.teleop.finish(session.operator)
    return parts.teleop.view


@router.websocket("/hand")
async def stream(websocket: WebSocket) -> None:
    """Take messages until the page closes; it has let go then, whatever it said before."""
    parts = parts_of(websocket)
    await websocket.accept()
    operator = ""
    waiting: asyncio.Queue[tuple[str, int] | None] = asyncio.Queue()
    listening = asyncio.create_task(_listen(websocket, parts, waiting))
    try:
        while (said := await waiting.get()) is not None:
            text, came_ns = said
            session = session_now(websocket)
            if session is None:
                break
            operator = session.operator
            answer: dict[str, Any] = {"error": None}
            try:
                message = _MESSAGES.validate_json(text)
                answer["sent"] = message.sent
                await _note(parts, operator, message.failed)
                _act(parts, operator, message, came_ns)
            except ValidationError as error:
                answer["error"] = problem(error, "message")
                if error.errors()[0]["loc"][:1] in _OF_HANDS:  # a pose without numbers is a hand that was lost
                    with contextlib.suppress(RobotRefused):
                        parts.teleop.drop(operator, answer["error"])
            except RobotRefused as refused:
                answer["error"] = str(refused)
            await websocket.send_json(answer | asdict(parts.teleop.view))
            await asyncio.sleep(0)  # neither queue nor socket gives way by itself: a flood would hold all others up
    except (WebSocketDisconnect, RuntimeError):
        pass  # the page has gone
    finally:
        listening.cancel()
        parts.teleop.release(operator, Release.LOST)
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        await websocket.close(*SIGNED_OUT)


async def _note(parts: Parts, operator: str, failed: str) -> None:
    """Fail the operator's run, whose device has ended: on the pages, in log and result. Raises RobotRefused."""
    if failed:
        parts.teleop.set(operator)  # which only who has control may
        await asyncio.to_thread(parts.client.request, NoteRequest(operator, failed, True))


async def _listen(websocket: WebSocket, parts: Parts, waiting: asyncio.Queue[tuple[str, int] | None]) -> None:
    """Queue what comes with its time, None at the end. STOP does not queue."""
    stops = []  # that are under way
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        async for text in websocket.iter_text():
            waiting.put_nowait((text, time.monotonic_ns()))
            if '"stop"' in text and (session := session_now(websocket)) is not None and _stops(text):
                stops.append(asyncio.create_task(_stop(websocket, parts, session)))
            if waiting.qsize() > _MOST_WAITING:
                break
    waiting.put_nowait(None)


async def _stop(websocket: WebSocket, parts: Parts, session: UserSession) -> None:
    """Ask for a controlled stop; answer at once where the loop does not take it."""
    try:
        await request_stop(parts, session)
    except RobotUnreachable as error:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            await websocket.send_json({"error": str(error)} | asdict(parts.teleop.view))


def _stops(text: str) -> bool:
    with contextlib.suppress(ValidationError):
        return _MESSAGES.validate_json(text).stop
    return False


def _act(parts: Parts, operator: str, message: TeleopMessage, came_ns: int | None = None) -> None:
    """Carry a message out, as far as the gate lets it through. Raises RobotRefused."""
    teleop = parts.teleop
    settings = (message.coupling, message.speed_m_s, message.stiffness_n_m, message.handles)
    if any(setting is not None for setting in settings):
        teleop.set(operator, *settings)
    if message.clutch is False:
        teleop.release(operator, Release.LOST if message.lost else Release.RELEASED)
        return
    if not message.tracked:
        teleop.drop(operator, "a hand is not tracked")
    motions = (message.pose, message.hands, message.lead, message.deflection)
    if not (message.clutch or message.grip or any(motion is not None for motion in motions)):
        return
    # a message of an arm that the cell lacks is refused before all else
    given = message.sensed, message.pose, message.hands, message.deflection
    sensed, pose, hands, deflection = (_of_arms(parts, said) for said in given)
    admission = teleop.admit(operator, message.stamp, came_ns)
    if not admission.alive:
        return
    if message.clutch:
        teleop.press(operator, admission.latest_ns, message.lead)
    elif message.grip:
        teleop.grip(operator, admission.latest_ns)
    if admission.drop is not None:
        return
    asked: dict[Callable[[str, Any], None], Any] = {teleop.sense: sensed, teleop.move: pose, teleop.track: hands}
    for ask, motion in (asked | {teleop.lead: message.lead, teleop.jog: deflection}).items():
        if motion is not None:
            ask(operator, motion)


def _of_arms(parts: Parts, said: PadPoses | Deflections | None) -> OfArms | None:
    """Return what is said of each arm of the cell. Raises RobotRefused where something is said of one that it lacks."""
    if said is None:
        return None
    values = {side: None if getattr(said, side) is None else np.array(getattr(said, side)) for side in SIDES}
    for side in set(SIDES) - set(parts.cell.sides):
        if values[side] is not None:
            raise RobotRefused(f"the cell {parts.cell.name} has no {side} arm: leave `{side}` out")
    return [values[side] for side in parts.cell.sides]
