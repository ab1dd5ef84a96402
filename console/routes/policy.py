"""A policy that leads the arms: an operator gives it a lease; it is asked over a WebSocket, 10 to 50 times a second.

docs/howto/policy.md has the messages, and what ends a lease. An answer that is missing, late or wrong is no sign of
life: the robot process stops the arms when CLUTCH_S (rtstack.loop.watchdogs) have passed without one.
"""

import asyncio
import time
from contextlib import suppress
from functools import cached_property
from typing import Annotated

import msgspec
import numpy as np
from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from console.live.arm_watch import in_world
from console.parts import NeedsParts, NeedsSession, Parts, parts_of, session_now
from console.routes.problems import problems
from console.routes.sockets import SIGNED_OUT
from console.teleoperation.teleop_view import TeleopView
from hal.desk.state import plain
from rtstack.cameras.newest import NewestPictures
from rtstack.live.client import RobotRefused, RobotUnreachable
from rtstack.live.protocol import NoteRequest, Operator
from rtstack.loop.mailbox import CHUNK_POSES
from rtstack.messages import MESSAGE, NUMBER, StrictBool, StrictFloat, problem
from rtstack.model.arm_model import ArmModel
from rtstack.model.cell_description import base_frame
from rtstack.samples import Mode
from rtstack.teleoperation.policy import FASTEST_HZ, LONGEST_STEP_S, SLOWEST_HZ, Chunk, Observation
from rtstack.trials.assembly import cell_parameters

router = APIRouter(prefix="/api/policy", tags=["teleoperation"], responses=problems(409))

_WAIT_S = 0.2
_Seven = Annotated[list[StrictFloat], Field(min_length=7, max_length=7)]
_Steps = Annotated[
    list[Annotated[list[_Seven], Field(min_length=1, max_length=2)]], Field(min_length=1, max_length=CHUNK_POSES)
]


class PolicyInput:
    """One connection of a policy: what it sees, and its answers on their way into the mailbox. For any thread."""

    def __init__(self, name: str, parts: Parts) -> None:
        self._name, self._teleop, self._mailbox, self._watch = name, parts.teleop, parts.mailbox, parts.watch
        self._cell, cell, rings = parts.cell, parts.cell, parts.watch.rings
        self._bases = [base_frame(mounting) for mounting in cell.arms]
        self._arms = [rings.reader(f"/{side}/arm") for side in cell.sides]
        self._controls = [rings.reader(f"/{side}/control") for side in cell.sides]
        self._pictures = NewestPictures({})
        self._lease: tuple[int, int] | None = None
        self._number, self._began_ns = 0, 0
        self.failed = False  # it has ended by an exception of its own
        self._shown: Observation | None = None
        self._pads = [np.zeros(7) for _ in cell.arms]  # where they were last

    def observe(self) -> Observation | None:
        """Return what the arms say now, None without a lease or before the teleoperation says where they are to be."""
        lease = self._teleop.lease(self._name)
        arms, controls = ([reader.latest() for reader in readers] for readers in (self._arms, self._controls))
        self._shown = None
        if lease is None or any(record is None for record in (*arms, *controls)):
            return None
        arms, controls = ([record[0] for record in records if record is not None] for records in (arms, controls))
        if any(control["mode"] != Mode.TELEOPERATION for control in controls):
            return None  # what an idle cell says has no reference
        t_ns = int(arms[0]["t_ns"])
        if lease != self._lease:
            self._lease, self._began_ns = lease, t_ns
            self._pictures.close()
            self._pictures = NewestPictures({})
            with suppress(OSError):  # the run has just ended, and its pictures with it
                self._pictures = NewestPictures(self._watch.cameras())
        self._number += 1
        pads = [in_world(*each) for each in zip(self._bases, arms, self._pads, strict=True)]
        self._pads = [pose for pose, _ in pads]
        self._shown = Observation(
            self._number, t_ns, (t_ns - self._began_ns) * 1e-9,
            np.stack([arm["q"] for arm in arms]), np.stack([arm["dq"] for arm in arms]),
            np.stack([pad[0] for pad in pads]), np.stack([control["pose_ref"] for control in controls]),
            np.stack([pad[1] for pad in pads]), self._watch.object_pose(), self._pictures.at(t_ns),
        )  # fmt: skip
        return self._shown

    def take(self, text: str) -> str | None:
        """Take an answer. Returns in one line why it is not followed, None where it is."""
        try:
            answer = _ANSWERS.validate_json(text)
        except ValidationError as error:
            return problem(error, "answer")
        if answer.finished or answer.failed:
            self.failed = bool(answer.failed)
            self._teleop.end_lease(self._name)
            return answer.failed or None
        lease, shown = self._lease, self._shown
        if shown is None or answer.to != shown.number:
            return f"it answers observation {answer.to}, and the newest is {self._number}"
        self._shown = None  # one answer each
        if lease is None or lease != self._teleop.lease(self._name):
            return "the lease is over"
        chunk = answer.chunk()
        if (wrong := chunk.problem(len(self._cell.arms))) is not None:
            return wrong
        record = chunk.record(*self._models)
        record["job"], record["lease"] = lease
        record["observed_ns"], record["beat_ns"] = shown.t_ns, time.monotonic_ns()
        self._mailbox.write_chunk(record)
        return None

    @cached_property
    def _models(self) -> tuple[dict[str, ArmModel], int]:
        """What `Chunk.record` takes."""
        models = {side: ArmModel(mounting, self._cell.pad) for side, mounting in self._cell.mountings.items()}
        return models, cell_parameters(self._cell).control.posture_joint


@checked(frozen=True, slots=True, config=MESSAGE)
class LeaseOrder:
    """Which policy is to lead, by the name that its session or token has; null: none any more."""

    to: Operator | None


@checked(frozen=True, slots=True, config=MESSAGE)
class PolicyAnswer:
    """An answer: to which observation, and the chunk (rtstack.teleoperation.policy.Chunk): a row for each arm that the
    cell has, left before right."""

    to: Annotated[int, NUMBER]
    step_s: Annotated[StrictFloat, Field(gt=0.0, le=LONGEST_STEP_S)] = 0.02
    poses: _Steps | None = None
    joints: _Steps | None = None
    finished: StrictBool = False
    failed: Annotated[str, Field(max_length=400)] = ""  # the policy ends so, in its own words

    def chunk(self) -> Chunk:
        """Return it as a policy in this process would give it."""
        poses, joints = (None if each is None else np.array(each) for each in (self.poses, self.joints))
        return Chunk(self.step_s, poses, joints, self.finished)


_ANSWERS = TypeAdapter(PolicyAnswer)


async def _note(parts: Parts, policy: str, text: str, failed: bool) -> None:
    """Show what is wrong with a policy: on the pages, in the log, where it failed in the result, in the audit trail."""
    text = f"{'the policy has ended' if failed else 'the answer of the policy is not followed'}: {text}"
    parts.teleop.policies.refused = f"{policy}: {text}"
    with suppress(RobotRefused, RobotUnreachable):
        await asyncio.to_thread(parts.client.request, NoteRequest(policy, text, failed))


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
    policy, refused, noted = PolicyInput(name := session.operator, parts), None, None
    parts.teleop.policies.connected(name)
    try:
        while (session := session_now(websocket)) is not None and session.operator == name:
            observation = policy.observe()
            if observation is None:
                leads = parts.teleop.lease(name) is not None
                unlent = f"the operator in control has given {name} no lease"
                await websocket.send_json({"waiting": "the teleoperation has not begun" if leads else unlent})
                await asyncio.sleep(1.0 / rate_hz if leads else _WAIT_S)
                continue
            began_s = time.monotonic()
            shown = msgspec.to_builtins(observation, enc_hook=np.ndarray.tolist)  # bytes become base64
            await websocket.send_json({"observation": shown, "refused": refused})
            refused = policy.take(await websocket.receive_text())
            if refused not in (None, noted):
                noted = refused
                await _note(parts, name, plain(refused, 400), policy.failed)
            await asyncio.sleep(max(0.0, 1.0 / rate_hz - (time.monotonic() - began_s)))
    except (WebSocketDisconnect, RuntimeError):
        pass  # the policy has gone
    finally:
        parts.teleop.end_lease(name)
        parts.teleop.policies.connected(name, -1)
    with suppress(RuntimeError, WebSocketDisconnect):
        await websocket.close(*SIGNED_OUT)
