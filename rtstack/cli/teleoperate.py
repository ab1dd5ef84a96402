"""`rtstack teleoperate`: an input device by name moves the arms, through the same door as any other program."""

import json
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hal.extensions import PLUG_INS_RAISE, raised
from rtstack.cli.console_client import Operator, Stream
from rtstack.cli.exit_status import FAILED
from rtstack.cli.interrupt import interruptible
from rtstack.cli.options import ObjectName
from rtstack.live.protocol import JobState
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:
    from rtstack.teleoperation.device import InputDevice
    from rtstack.teleoperation.stamp import Sender

commands = typer.Typer()
PERIOD_S = 0.02  # of the device, and of the clutch's signs of life
BEAT_S = 0.5  # control is lost after 2 s without a sign of life
TIMEOUT_S = 30.0  # until the arms have said where they are
_ACTIVE = (JobState.STARTING, JobState.RUNNING, JobState.STOPPING)


@commands.command()
def teleoperate(
    device: Annotated[
        str, typer.Argument(metavar="NAME[:ARGUMENT]", help="An input device that an installed package offers.")
    ],
    token: Annotated[str, typer.Option(envvar="RTSTACK_TOKEN", help="Made by `rtstack token create --scope operate`.")],
    console: Annotated[str, typer.Option(metavar="URL", help="Of the console.")] = "http://127.0.0.1:8080",
    object_name: ObjectName = "rice_box",
    record: Annotated[bool, typer.Option("--record", help="As a recording, from home; else practise.")] = False,
) -> None:
    """Take control, arm, and let an input device lead the arms of a running stack; Ctrl-C ends it softly."""
    # a clutch that is let go holds the arms; a device that is silent stops them
    from rtstack.teleoperation.device import DEVICES
    from rtstack.teleoperation.stamp import Sender

    name, _, argument = device.partition(":")
    operator = Operator(console, token)
    with closing(operator), closing(DEVICES.make(name, argument, "read", "close")) as opened, interruptible() as stop:
        operator.post("take")
        operator.post("arm")
        asked = {"object": object_name, "recorded": record, "stop_on_release": False}
        job = operator.post("jobs/teleoperation", **asked)["job"]
        while job["state"] == JobState.STARTING:
            time.sleep(PERIOD_S)
            job = operator.post("beat")["job"]
        if job["state"] == JobState.RUNNING:
            with operator.hand() as stream:
                sender = Sender()
                hold(operator, stream, sender)
                job = lead(operator, opened, stream, sender, lambda: stop.stop_requested)
        while job["state"] in _ACTIVE:
            time.sleep(PERIOD_S)
            job = operator.post("beat")["job"]
        operator.post("release")
    typer.echo(f"{job['state']}: {job['reason'] or 'success'}" + (f", {job['log']}" if job.get("log") else ""))
    if job["state"] != JobState.DONE or job["reason"]:
        raise typer.Exit(FAILED)


def hold(operator: Operator, stream: Stream, sender: "Sender") -> None:
    """Hold the clutch as soon as the arms have said where they are: what a device says before that would be lost."""
    until_s = time.monotonic() + TIMEOUT_S
    _told(stream, sender, {})  # nothing asked: the answer is the first picture
    while reason := _told(stream, sender, {"clutch": True})["error"]:
        if time.monotonic() > until_s or operator.post("beat")["job"]["state"] not in _ACTIVE:
            raise TrialError(reason)
        time.sleep(PERIOD_S)


def _told(stream: Stream, sender: "Sender", message: dict[str, Any]) -> dict[str, Any]:
    stream.send(json.dumps(sender.stamped(message)))
    return sender.saw(json.loads(stream.recv(TIMEOUT_S)))


def lead(operator: Operator, device: "InputDevice", stream: Stream, sender: "Sender", stop: Any) -> dict[str, Any]:
    """Pass on what the device says, 50 times a second, until it has finished, or raises. Returns the job."""
    from rtstack.teleoperation.device import HandInput

    beat_s, refused, beaten = -BEAT_S, "", None
    with ThreadPoolExecutor(1) as beside:  # a robot process that answers late must not hold the clutch up
        while True:
            now_s = time.monotonic()
            try:
                if not isinstance(said := device.read(), HandInput):
                    raise TypeError(f"read returned a {type(said).__name__}, not a HandInput")
            except PLUG_INS_RAISE as error:  # whatever the code of another author raises
                reason = f"the input device has ended: {raised(error, device.read)}"
                typer.echo(f"rtstack: {reason}", err=True)
                _told(stream, sender, {"clutch": False, "failed": reason[:400]})
                said = HandInput(held=False, finished=True)
            if said.finished or stop():
                operator.post("teleoperation/finish")
                return operator.post("beat")["job"]
            answer = _told(stream, sender, said.message())
            reason = answer["error"] or answer.get("refusal") or ""
            if reason != refused:
                refused = reason
                typer.echo(reason or "the arms follow", err=True)
            if now_s - beat_s >= BEAT_S and (beaten is None or beaten.done()):
                if beaten is not None and (job := beaten.result()["job"])["state"] not in _ACTIVE:
                    return job
                beat_s, beaten = now_s, beside.submit(operator.post, "beat")
            time.sleep(max(0.0, PERIOD_S - (time.monotonic() - now_s)))
