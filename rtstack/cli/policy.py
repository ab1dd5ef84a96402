"""`rtstack policy`: a policy by name leads the arms, of a simulated cell in this process or of a stack that runs."""

import json as json_module
from base64 import b64decode
from contextlib import closing
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from hal.displacement import Displacement
from hal.extensions import PLUG_INS_RAISE, raised
from rtstack.cli.exit_status import FAILED
from rtstack.cli.interrupt import interruptible
from rtstack.cli.options import CellFile, Json, LogOut, ObjectName, Seed, ShiftX, ShiftY, Yaw
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:
    from rtstack.cli.console_client import Stream
    from rtstack.teleoperation.policy import Policy

commands = typer.Typer()
_ARRAYS = ("q", "dq", "pose", "pose_ref", "force")
_TIMEOUT_S = 30.0  # for the console to say anything


@commands.command()
def policy(
    name: Annotated[str, typer.Argument(metavar="NAME[:ARGUMENT]", help="A policy that an installed package offers.")],
    console: Annotated[
        str | None, typer.Option(metavar="URL", help="Of a running stack; else a simulated cell in this process.")
    ] = None,
    token: Annotated[
        str, typer.Option(envvar="RTSTACK_TOKEN", help="Made by `rtstack token create --scope operate`.")
    ] = "",
    rate_hz: Annotated[float, typer.Option(help="Observations a second, 10 to 50.")] = 20.0,
    object_name: ObjectName = "rice_box",
    displacement_mm: ShiftY = 0.0,
    displacement_x_mm: ShiftX = 0.0,
    yaw_deg: Yaw = 0.0,
    seed: Seed = 0,
    log: LogOut = None,
    cell_file: CellFile = None,
    json: Json = False,
) -> None:
    """Let a policy lead the arms, as an operator would: at a console once an operator gives it a lease there."""
    from rtstack.cli.terminal import Terminal, report
    from rtstack.trials.object import check_object
    from rtstack.trials.specification import TeleoperationSpecification
    from rtstack.trials.teleoperation import PreparedPolicy

    if console is not None:
        _run_at_console(name, rate_hz, console, token)
        return
    place = Displacement.given(displacement_mm, displacement_x_mm, yaw_deg)
    host = Terminal.of("direct", None, cell_file, f"policy {name}", log_path=log)
    check_object(object_name, host.description)
    specification = TeleoperationSpecification(host.what, object_name, seed)
    with closing(open_policy(name, rate_hz)) as opened:
        result = host.run(PreparedPolicy(specification, host.description, opened, rate_hz, place))
    report(result, json, f"{name}: {result.failure_reason or 'success'}, {result.duration_s:.1f} s")


def open_policy(name: str, rate_hz: float) -> "Policy":
    """Return an open policy by NAME[:ARGUMENT]. Raises TrialError or ExtensionError with one line."""
    from rtstack.teleoperation.policy import FASTEST_HZ, POLICIES, SLOWEST_HZ

    if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        raise TrialError(f"--rate-hz {rate_hz:g}: a policy is asked {SLOWEST_HZ} to {FASTEST_HZ} times a second")
    name, _, argument = name.partition(":")
    return POLICIES.make(name, argument, "act", "close")


def _run_at_console(name: str, rate_hz: float, console: str, token: str) -> None:
    """Answer a console's observations until Ctrl-C. An operator gives the lease there. Raises TrialError."""
    from rtstack.access.authority import Authority
    from rtstack.cli.console_client import authorization, open_stream

    headers, path = authorization(token), f"/api/policy?rate_hz={rate_hz:g}"
    with (
        closing(open_policy(name, rate_hz)) as policy,
        interruptible() as stop,
        open_stream(console, path, headers, Authority.trusting()) as stream,
    ):
        said = ""
        while not stop.stop_requested:
            message = json_module.loads(stream.recv(_TIMEOUT_S))
            line = message.get("waiting") or message.get("refused") or ""
            if line != said:
                said = line
                typer.echo(line or "the policy leads", err=True)
            if "observation" in message:
                _answer(stream, policy, message["observation"])


def _answer(stream: "Stream", policy: "Policy", shown: dict[str, Any]) -> None:
    """Have the policy answer one observation; where it has no answer, the console is sent one that it refuses."""
    from rtstack.cameras.newest import Picture
    from rtstack.teleoperation.policy import Chunk, Observation, answer_of

    arrays = {key: np.array(shown[key]) for key in _ARRAYS}
    pose = None if shown["object_pose"] is None else np.array(shown["object_pose"])
    pictures = {name: Picture(each["t_ns"], b64decode(each["jpeg"])) for name, each in shown["pictures"].items()}
    numbers = shown["number"], shown["t_ns"], shown["t_s"]
    try:
        observation = Observation(*numbers, **arrays, object_pose=pose, pictures=pictures)
        chunk = answer_of(policy, observation, len(observation.q))[0] or Chunk()
        named = {"poses": chunk.poses, "joints": chunk.joints}
        said = {key: np.asarray(value).tolist() for key, value in named.items() if value is not None}
    except PLUG_INS_RAISE as error:
        reason = raised(error, policy.act)
        stream.send(json_module.dumps({"to": shown["number"], "failed": reason[:400]}))
        stream.recv(_TIMEOUT_S)  # it has been taken
        typer.echo(f"rtstack: the policy has ended: {reason}", err=True)
        raise typer.Exit(FAILED) from error
    said = {"finished": True} if chunk.finished else {"step_s": chunk.step_s} | said
    stream.send(json_module.dumps({"to": shown["number"]} | said))
