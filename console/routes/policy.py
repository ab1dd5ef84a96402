"""A policy that leads the arms: an operator gives it a lease; it is asked over a WebSocket, 10 to 50 times a second.

The console sends one observation (rtstack.teleoperation.policy.Observation, as JSON), the policy answers it with `to`,
its number, and a chunk: `step_s` and `poses` or `joints`, or `finished`. The next observation follows a step later,
with `refused`, why the last answer is not followed, or null. While the policy has no lease, the console says `waiting`.
Pictures are JPEG in base64.
An answer that is missing, late or wrong is no sign of life: the robot process stops the arms when CLUTCH_S
(rtstack.loop.watchdogs) have passed without one. A connection that closes ends the lease, and the arms hold.
"""

import asyncio
import time
from base64 import b64encode
from contextlib import suppress
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from console.parts import NeedsParts, NeedsSession, parts_of, session_now
from console.routes.problems import problems
from console.teleoperation.policy_input import PolicyInput
from console.teleoperation.teleop_view import TeleopView
from rtstack.live.protocol import Operator
from rtstack.loop.target import CHUNK_POSES
from rtstack.messages import MESSAGE, NUMBER, StrictBool, StrictFloat
from rtstack.teleoperation.policy import FASTEST_HZ, LONGEST_STEP_S, SLOWEST_HZ, Chunk, Observation

router = APIRouter(prefix="/api/policy", tags=["teleoperation"], responses=problems(409))

_WAIT_S = 0.2
_Seven = Annotated[list[StrictFloat], Field(min_length=7, max_length=7)]
_Steps = Annotated[
    list[Annotated[list[_Seven], Field(min_length=2, max_length=2)]], Field(min_length=1, max_length=CHUNK_POSES)
]


@checked(frozen=True, slots=True, config=MESSAGE)
class LeaseOrder:
    """Which policy is to lead, by the name that its session or token has; null: none any more."""

    to: Operator | None


@checked(frozen=True, slots=True, config=MESSAGE)
class PolicyAnswer:
    """An answer: to which observation, and the chunk (rtstack.teleoperation.policy.Chunk)."""

    to: Annotated[int, NUMBER]
    step_s: Annotated[StrictFloat, Field(gt=0.0, le=LONGEST_STEP_S)] = 0.02
    poses: _Steps | None = None
    joints: _Steps | None = None
    finished: StrictBool = False

    def chunk(self) -> Chunk:
        """Return it as a policy in this process would give it."""
        poses, joints = (None if each is None else np.array(each) for each in (self.poses, self.joints))
        return Chunk(self.step_s, poses, joints, self.finished)


_ANSWERS = TypeAdapter(PolicyAnswer)


@router.post("/lease")
def lend(order: LeaseOrder, session: NeedsSession, parts: NeedsParts) -> TeleopView:
    """Let a policy lead in the teleoperation that runs, or take its lease back, as holding the clutch does."""
    parts.teleop.lend(session.operator, order.to)
    return parts.teleop.view


@router.websocket("")
async def stream(websocket: WebSocket, rate_hz: float = 20.0) -> None:
    """Show and ask until the policy has gone."""
    parts, session = parts_of(websocket), session_now(websocket)
    await websocket.accept()
    if session is None or not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        await websocket.close(1008, f"rate_hz is from {SLOWEST_HZ} to {FASTEST_HZ}")
        return
    name = session.operator
    policy = PolicyInput(name, parts.teleop, parts.mailbox, parts.watch.rings, parts.cell, parts.watch.cameras)
    refused: str | None = None
    parts.teleop.policy_connected(name)
    try:
        while (session := session_now(websocket)) is not None and session.operator == name:
            observation = policy.observe()
            if observation is None:
                leads = policy.leads
                lacks = (
                    "the teleoperation has not begun" if leads else f"the operator in control has given {name} no lease"
                )
                await websocket.send_json({"waiting": lacks})
                await asyncio.sleep(1.0 / rate_hz if leads else _WAIT_S)
                continue
            began_s = time.monotonic()
            await websocket.send_json({"observation": _plain(observation), "refused": refused})
            refused = _take(policy, await websocket.receive_text(), parts.teleop.end_lease, name)
            await asyncio.sleep(max(0.0, 1.0 / rate_hz - (time.monotonic() - began_s)))
    except (WebSocketDisconnect, RuntimeError):
        pass  # the policy has gone
    finally:
        parts.teleop.end_lease(name)
        parts.teleop.policy_connected(name, -1)
    with suppress(RuntimeError, WebSocketDisconnect):
        await websocket.close(1008, "not signed in any more")


def _take(policy: PolicyInput, text: str, end_lease: Any, name: str) -> str | None:
    """Take an answer; return why it is not followed."""
    try:
        answer = _ANSWERS.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        return f"{'.'.join(str(part) for part in first['loc']) or 'answer'}: {first['msg']}"
    if answer.finished:
        end_lease(name)
        return None
    return policy.answer(answer.to, answer.chunk())


def _plain(observation: Observation) -> dict[str, Any]:
    """Return an observation as JSON-ready values."""
    arrays = {key: getattr(observation, key) for key in ("q", "dq", "pose", "pose_ref", "force", "object_pose")}
    numbers = {key: getattr(observation, key) for key in ("number", "t_ns", "t_s")}
    pictures = {
        name: {"t_ns": each.t_ns, "jpeg": b64encode(each.jpeg).decode()} for name, each in observation.pictures.items()
    }
    values = {key: None if value is None else value.tolist() for key, value in arrays.items()}
    return numbers | values | {"pictures": pictures}
