"""`rtstack teleoperate`: an input device by name moves the arms, through the same door as any other program."""

import json
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from typing import Any

import httpx
import typer
from websockets.exceptions import WebSocketException

from console.authority import Authority
from hal.extensions import ExtensionError
from rtstack.cli.interrupt import interruptible
from rtstack.cli.stream import Stream, open_stream
from rtstack.live.protocol import JobState
from rtstack.teleoperation.device import DEVICES, InputDevice
from rtstack.teleoperation.stamp import Sender
from rtstack.trials.errors import TrialError

PERIOD_S = 0.02  # of the device, and of the clutch's signs of life
BEAT_S = 0.5  # control is lost after 2 s without a sign of life
TIMEOUT_S = 30.0  # to open a cell of a simulated robot takes seconds
BUSY, FAILED = 503, 1
_ACTIVE = (JobState.STARTING, JobState.RUNNING, JobState.STOPPING)


class Operator:
    """A program that is signed in to a console. Raises TrialError with the console's reason."""

    def __init__(self, address: str, token: str) -> None:
        self._address, self._headers = address, {"authorization": f"Bearer {token}"}
        self._tls = Authority.trusting()
        self._http = httpx.Client(
            base_url=address, headers=self._headers, timeout=TIMEOUT_S, trust_env=False, verify=self._tls
        )
        self.close = self._http.close

    def post(self, path: str, **body: object) -> dict[str, Any]:
        """Ask for something; return the answer."""
        try:
            answer = self._http.post(f"/api/{path}", json=body)
            while answer.status_code == BUSY and path == "beat":  # the robot process answers late: nothing is lost yet
                time.sleep(PERIOD_S)
                answer = self._http.post(f"/api/{path}", json=body)
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise TrialError(f"{self._address}: no console answers ({error}); start one with rtstack up") from None
        if answer.is_error:
            raise TrialError(f"{path}: {_reason(answer)}")
        return answer.json()

    @contextmanager
    def hand(self) -> Iterator[Stream]:
        """Give the stream of hand messages; closing it lets go."""
        address = self._address.replace("http", "ws", 1).rstrip("/") + "/api/teleoperation/hand"
        try:
            with open_stream(address, self._headers, self._tls) as stream:
                yield stream
        except (WebSocketException, OSError) as error:
            raise TrialError(f"the connection to {self._address} has broken: {error}") from None


def teleoperate(name: str, address: str, token: str, object_name: str, recorded: bool) -> None:
    """Take control, arm, and let a device lead until it has finished or Ctrl-C. Raises TrialError.

    A clutch that is let go holds the arms; a device that is silent stops them.
    """
    name, _, argument = name.partition(":")
    if not token.isascii() or not token.isprintable() or not token:
        raise TrialError("--token is no token: make one with rtstack token create --scope operate")
    try:
        factory = DEVICES.load(name)
    except ExtensionError as error:
        raise TrialError(str(error)) from None
    with closing(Operator(address, token)) as operator, interruptible() as stop:
        operator.post("take")
        operator.post("arm")
        asked = {"object": object_name, "recorded": recorded, "stop_on_release": False}
        job = operator.post("jobs/teleoperation", **asked)["job"]
        while job["state"] == JobState.STARTING:
            time.sleep(PERIOD_S)
            job = operator.post("beat")["job"]
        if job["state"] == JobState.RUNNING:
            with operator.hand() as stream:
                sender = Sender()
                hold(operator, stream, sender)
                with closing(factory(argument)) as device:
                    job = lead(operator, device, stream, sender, lambda: stop.stop_requested)
        while job["state"] in _ACTIVE:
            time.sleep(PERIOD_S)
            job = operator.post("beat")["job"]
        operator.post("release")
    typer.echo(f"{job['state']}: {job['reason'] or 'success'}" + (f", {job['log']}" if job.get("log") else ""))
    if job["state"] != JobState.DONE:
        raise typer.Exit(FAILED)


def hold(operator: Operator, stream: Stream, sender: Sender) -> None:
    """Hold the clutch as soon as the arms have said where they are: what a device says before that would be lost."""
    until_s = time.monotonic() + TIMEOUT_S
    _told(stream, sender, {})  # nothing asked: the answer is the first picture
    while reason := _told(stream, sender, {"clutch": True})["error"]:
        if time.monotonic() > until_s or operator.post("beat")["job"]["state"] not in _ACTIVE:
            raise TrialError(reason)
        time.sleep(PERIOD_S)


def _told(stream: Stream, sender: Sender, message: dict[str, Any]) -> dict[str, Any]:
    stream.send(json.dumps(sender.stamped(message)))
    return sender.saw(json.loads(stream.recv(TIMEOUT_S)))


def lead(operator: Operator, device: InputDevice, stream: Stream, sender: Sender, stop: Any) -> dict[str, Any]:
    """Pass on what the device says, 50 times a second, until it has finished. Returns the job."""
    beat_s, refused, beaten = -BEAT_S, "", None
    with ThreadPoolExecutor(1) as beside:  # a robot process that answers late must not hold the clutch up
        while True:
            now_s = time.monotonic()
            said = device.read()
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


def _reason(answer: httpx.Response) -> str:
    try:
        return str(answer.json()["error"])
    except (ValueError, KeyError, TypeError):
        return f"the console answers {answer.status_code}"
