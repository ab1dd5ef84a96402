"""`rtstack up` with one arm, in this process's plant or served: it is armed, moved, led, recorded and played back."""

import contextlib
import json
import time

import numpy as np
import pytest

from rtstack.log.reader import read_log
from rtstack.samples import SIDES
from rtstack.teleoperation.stamp import Sender
from tests.support.console.client import wait_for
from tests.support.console.stack import Stack
from tests.support.fci.server import serve
from tests.support.one_arm import one_arm_file

pytestmark = [pytest.mark.alone, pytest.mark.timeout(600)]
RAISED_M, STEP_M = 0.04, 0.002


def job_of(stack):
    return stack.client.get("/api/status").raise_for_status().json()["job"]


def ended(stack):
    wait_for(lambda: job_of(stack)["state"] in ("done", "stopped", "failed"))
    return job_of(stack)


@contextlib.contextmanager
def hand(stack):
    """Give a function that says something as the page does, and returns the answer."""
    sender = Sender()
    with stack.socket("/api/teleoperation/hand") as stream:

        def say(**message):
            stream.send(json.dumps(sender.stamped(message)))
            return sender.saw(json.loads(stream.recv(60)))

        stream.send("{}")
        sender.saw(json.loads(stream.recv(60)))
        yield say


def pad_of(stack, side):
    """The pad's place, m, as the console last drew it."""
    with stack.socket("/live") as page:
        while True:
            view = json.loads(page.recv(60))
            assert view[SIDES[1 - SIDES.index(side)]] is None
            if view["places"] is not None:
                (pad,) = view["places"]["pads"]
                return np.array(pad)


def raised(stack, side):
    """Record how the pad is led upwards, keeping the clutch held."""
    begin = pad_of(stack, side)
    with hand(stack) as say:
        wait_for(lambda: say(clutch=True)["error"] is None)
        for k in range(round(RAISED_M / STEP_M)):
            pose = begin + np.eye(7)[2] * STEP_M * (k + 1)
            say(clutch=True, pose={side: pose.tolist()})
            time.sleep(0.02)
        wait_for(lambda: say(clutch=True) and pad_of(stack, side)[2] >= begin[2] + 0.7 * RAISED_M)
        say(clutch=True)
        stack.post("teleoperation/finish")


def all_of_it(stack, side):
    with stack.beating():
        stack.post("take")
        stack.post("arm")
        assert stack.run("jobs/move", motion="start")
        stack.post("jobs/teleoperation", object="rice_box", recorded=True)
        while job_of(stack)["state"] == "starting":
            time.sleep(0.1)
        raised(stack, side)
        job = ended(stack)
        assert (job["state"], job["success"]) == ("done", True), job
        log = read_log(stack.logs / job["log"])
        assert len(log.topic(f"/{side}/arm")) > 100
        assert len(log.topic(f"/{SIDES[1 - SIDES.index(side)]}/arm")) == 0
        stack.run("jobs/playback", log=stack.log_id(job["log"]), speed=0.5)
        stack.post("jobs/guide")
        with hand(stack) as say:
            wait_for(lambda: say(clutch=True)["error"] is None)
            end_s = time.monotonic() + 1.0
            while time.monotonic() < end_s:
                say(clutch=True)
                time.sleep(0.02)
            assert job_of(stack)["state"] == "running"
            say(clutch=False)
        assert ended(stack)["state"] == "done"
        assert stack.client.get("/api/status").json()["phase"] != "fault"


def test_the_simulated_arm_is_moved_led_recorded_and_played_back(tmp_path):
    logs = tmp_path / "logs"
    logs.mkdir()
    stack = Stack(logs, ["--cell-file", str(one_arm_file(tmp_path, "right"))])
    try:
        all_of_it(stack, "right")
    finally:
        assert stack.end() == []


@pytest.mark.long  # the same with a served arm, which tests/fci/test_one_arm.py covers by itself
def test_one_served_arm_of_a_cell_with_two_is_all_that_the_console_knows(tmp_path):
    logs = tmp_path / "logs"
    logs.mkdir()
    with serve("--only", "left") as served:
        stack = Stack(logs, ["--left", served.left])
        try:
            all_of_it(stack, "left")
        finally:
            assert stack.end() == []
