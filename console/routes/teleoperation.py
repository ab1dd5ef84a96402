"""Teleoperation: a WebSocket and plain requests. A program moves the arms in the same way as the page.

A message may hold any of: clutch (true holds it, and is its sign of life; false lets go; lost: because the operator is
out of sight), grip (a mouse button is down in the scene: a drag of a gizmo holds the clutch), coupling, handles
(whether the gizmos move or turn), speed_m_s, stiffness_n_m, lead (the hands back to before the last drag, or upright),
and for each arm a pose (position m, wxyz) or a deflection (-1..1 along and about the world's axes). A clutch that is
held has to be said again, as the page does every 50 ms: the robot process stops the arms when CLUTCH_S
(rtstack.loop.watchdogs) have passed without.
"""

import contextlib
from dataclasses import asdict
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from console.parts import NeedsParts, NeedsSession, Parts, parts_of, session_now
from console.routes.problems import problems
from console.teleoperation.devices import Placed
from console.teleoperation.pair import Coupling
from console.teleoperation.teleop_input import Handles, Lead, TeleopView
from rtstack.live.client import RobotRefused
from rtstack.loop.target import Release
from rtstack.messages import MESSAGE, StrictBool, StrictFloat
from rtstack.teleoperation.reach import FASTEST_M_S, HARDEST_N_M, SLOWEST_M_S, SOFTEST_N_M

router = APIRouter(prefix="/api/teleoperation", tags=["teleoperation"], responses=problems(409))

_Pose = Annotated[list[Annotated[StrictFloat, Field(ge=-10.0, le=10.0)]], Field(min_length=7, max_length=7)]
_Deflection = Annotated[list[Annotated[StrictFloat, Field(ge=-1.0, le=1.0)]], Field(min_length=6, max_length=6)]


@checked(frozen=True, slots=True, config=MESSAGE)
class PadPoses:
    """A pose for each arm, or for one of them: position, m, and quaternion wxyz, both in the world (7 numbers)."""

    left: _Pose | None = None
    right: _Pose | None = None


@checked(frozen=True, slots=True, config=MESSAGE)
class Deflections:
    """A deflection for each arm, or for one: along and about the world's axes, -1 to 1 of the speed (6 numbers)."""

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
    deflection: Deflections | None = None
    grip: StrictBool = False
    handles: Handles | None = None
    lead: Lead | None = None
    sent: StrictFloat | None = None  # comes back, so that a page can tell how long a beat takes


_MESSAGES = TypeAdapter(TeleopMessage)


@router.post("/hand")
def request(message: TeleopMessage, session: NeedsSession, parts: NeedsParts) -> TeleopView:
    """Do what a message says, once. The clutch goes quiet unless it is said again."""
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
    try:
        while True:
            text = await websocket.receive_text()
            session = session_now(websocket)
            if session is None:
                break
            operator = session.operator
            answer: dict[str, Any] = {"error": None}
            try:
                message = _MESSAGES.validate_json(text)
                answer["sent"] = message.sent
                _act(parts, operator, message)
            except ValidationError as error:
                first = error.errors(include_url=False, include_input=False)[0]
                answer["error"] = f"{'.'.join(str(part) for part in first['loc']) or 'message'}: {first['msg']}"
            except RobotRefused as refused:
                answer["error"] = str(refused)
            await websocket.send_json(answer | asdict(parts.teleop.view))
    except (WebSocketDisconnect, RuntimeError):
        pass  # the page has gone
    finally:
        parts.teleop.release(operator, Release.LOST)
    with contextlib.suppress(RuntimeError):
        await websocket.close(1008, "not signed in any more")


def _act(parts: Parts, operator: str, message: TeleopMessage) -> None:
    """Carry a message out. Raises RobotRefused."""
    teleop = parts.teleop
    settings = (message.coupling, message.speed_m_s, message.stiffness_n_m, message.handles)
    if any(setting is not None for setting in settings):
        teleop.set(operator, *settings)
    if message.clutch is False:
        teleop.release(operator, Release.LOST if message.lost else Release.RELEASED)
    elif message.clutch:
        teleop.press(operator)
    elif message.grip:
        teleop.grip(operator)
    if message.pose is not None:
        teleop.move(operator, Placed(_array(message.pose.left), _array(message.pose.right)))
    if message.lead is not None:
        teleop.lead(operator, message.lead)
    if message.deflection is not None:
        teleop.jog(operator, _array(message.deflection.left), _array(message.deflection.right))


def _array(values: list[float] | None) -> Any:
    return None if values is None else np.array(values)
