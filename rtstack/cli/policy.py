"""`rtstack policy`: a policy by name leads the arms, of a simulated cell in this process or of a stack that runs."""

import json
from base64 import b64decode
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import typer
from websockets.exceptions import WebSocketException

from console.authority import Authority
from hal.displacement import Displacement
from hal.extensions import ExtensionError
from rtstack.cameras.newest import Picture
from rtstack.cells import load_description, open_cell
from rtstack.cli.interrupt import interruptible
from rtstack.cli.stream import Stream, open_stream
from rtstack.log.writer import check_log_path
from rtstack.loop.watchdogs import Parent
from rtstack.teleoperation.policy import FASTEST_HZ, POLICIES, SLOWEST_HZ, Chunk, Observation, Policy
from rtstack.trials.errors import TrialError
from rtstack.trials.object import check_object
from rtstack.trials.policy import run_policy
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import TeleoperationSpecification

FAILED = 1
_ARRAYS = ("q", "dq", "pose", "pose_ref", "force")
_TIMEOUT_S = 30.0  # for the console to say anything


def open_policy(name: str, rate_hz: float) -> Policy:
    """Return an open policy by NAME[:ARGUMENT]. Raises TrialError with one line."""
    if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        raise TrialError(f"--rate-hz {rate_hz:g}: a policy is asked {SLOWEST_HZ} to {FASTEST_HZ} times a second")
    name, _, argument = name.partition(":")
    try:
        return POLICIES.load(name)(argument)
    except ExtensionError as error:
        raise TrialError(str(error)) from None


def run_in_process(
    name: str,
    rate_hz: float,
    object_name: str,
    displacement: Displacement,
    seed: int,
    log_path: Path | None,
    json: bool,
    cell_file: Path | None = None,
) -> None:
    """Let a policy lead the arms of the simulated cell in this process. Raises TrialError."""
    description, source = load_description(cell_file)
    check_object(object_name, description)
    if log_path is not None:
        check_log_path(log_path)
    specification = TeleoperationSpecification(f"policy {name}", object_name, seed)
    with closing(open_policy(name, rate_hz)) as policy, interruptible() as stop:
        cell = open_cell("direct", object_name, displacement, seed, description, cell_file=source)
        try:
            log = None
            if log_path is not None:
                log = open_log(log_path, specification, description, cell.name, source, cell=cell)
            context = RunContext(log, stop=stop, watchdogs=(Parent(),))
            result = run_policy(policy, specification, description, cell, context, rate_hz=rate_hz)
        finally:
            cell.close()
    typer.echo(result.as_json() if json else f"{name}: {result.failure_reason or 'success'}, {result.duration_s:.1f} s")
    if not result.success:
        raise typer.Exit(FAILED)


def run_at_console(name: str, rate_hz: float, address: str, token: str) -> None:
    """Answer a console's observations until Ctrl-C. An operator gives the lease there. Raises TrialError."""
    if not token.isascii() or not token.isprintable() or not token:
        raise TrialError("--token is no token: make one with rtstack token create --scope operate")
    headers, tls = {"authorization": f"Bearer {token}"}, Authority.trusting()
    url = address.replace("http", "ws", 1).rstrip("/") + f"/api/policy?rate_hz={rate_hz:g}"
    with closing(open_policy(name, rate_hz)) as policy, interruptible() as stop:
        try:
            with open_stream(url, headers, tls) as stream:
                said = ""
                while not stop.stop_requested:
                    message = json.loads(stream.recv(_TIMEOUT_S))
                    line = message.get("waiting") or message.get("refused") or ""
                    if line != said:
                        said = line
                        typer.echo(line or "the policy leads", err=True)
                    if "observation" in message:
                        answer(stream, policy, message["observation"])
        except (WebSocketException, OSError, httpx.InvalidURL) as error:
            raise TrialError(f"the connection to {address} has broken: {error}") from None


def answer(stream: Stream, policy: Policy, shown: dict[str, Any]) -> None:
    """Have the policy answer one observation; where it has no answer, the console is sent one that it refuses."""
    arrays = {key: np.array(shown[key]) for key in _ARRAYS}
    pose = None if shown["object_pose"] is None else np.array(shown["object_pose"])
    pictures = {name: Picture(each["t_ns"], b64decode(each["jpeg"])) for name, each in shown["pictures"].items()}
    numbers = shown["number"], shown["t_ns"], shown["t_s"]
    chunk = policy.act(Observation(*numbers, **arrays, object_pose=pose, pictures=pictures))
    stream.send(json.dumps({"to": shown["number"]} | message_of(chunk or Chunk())))


def message_of(chunk: Chunk) -> dict[str, Any]:
    """Return a chunk as the console takes it."""
    if chunk.finished:
        return {"finished": True}
    named = {"poses": chunk.poses, "joints": chunk.joints}
    return {"step_s": chunk.step_s} | {key: value.tolist() for key, value in named.items() if value is not None}
