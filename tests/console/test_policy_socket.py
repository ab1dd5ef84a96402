"""A policy through the console: what it is shown, which of its answers reach the mailbox, and who gives the lease."""

import asyncio
import json
from base64 import b64encode
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pytest
from websockets.sync.client import connect

from rtstack.access.tokens import Scope
from rtstack.log.writing.pictures import PictureRing
from rtstack.loop.mailbox import CHUNK, TARGET
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, SIDES, Level, Mode
from tests.support.console.client import arm, say, wait_for

POSES = [[0.0, 0.35, 0.26, 1.0, 0.0, 0.0, 0.0], [0.0, -0.35, 0.26, 1.0, 0.0, 0.0, 0.0]]


@pytest.fixture
def running(served):
    """A console whose robot process carries out a teleoperation, its operator, and a token for a policy."""
    with served.signed_in() as (client, headers):
        arm(client, headers)
        order = {"object": "rice_box"}
        assert client.post("/api/jobs/teleoperation", json=order, headers=headers).status_code == 202
        served.job_manager.started("x.mcap")
        push(served, 1_000_000)
        wait_for(lambda: served.parts.watch.command() is not None and served.parts.teleop.running)
        _, token = served.parts.sign_in.tokens.create("grabber", Scope.OPERATE)
        yield served, client, headers, token


def push(served, t_ns, mode=Mode.TELEOPERATION):
    sample, control = np.zeros(1, ARM_SAMPLE), np.zeros(1, CONTROL_SAMPLE)
    sample["O_T_EE"], sample["t_ns"], control["mode"] = np.eye(4), t_ns, mode
    for side, pose in zip(SIDES, POSES, strict=True):
        control["pose_ref"] = pose
        served.rings.pusher(f"/{side}/arm").push(sample)
        served.rings.pusher(f"/{side}/control").push(control)


@contextmanager
def policy(served, token, query="?rate_hz=50"):
    """Give the functions that take a message of a kind, and send one."""
    address = f"ws://127.0.0.1:{served.port}/api/policy{query}"
    with connect(address, additional_headers={"authorization": f"Bearer {token}"}, proxy=None) as stream:

        def take(kind):
            while True:
                message = json.loads(stream.recv(timeout=60))
                if kind in message:
                    return message

        yield take, lambda **message: stream.send(json.dumps(message))


def lend(client, headers, to="grabber"):
    return client.post("/api/policy/lease", json={"to": to}, headers=headers)


def target(served):
    record = np.zeros(1, TARGET)
    served.mailbox.read_target(record)
    return record[0]


def chunk(served):
    record = np.zeros(1, CHUNK)
    served.mailbox.read_chunk(record)
    return record[0]


def test_a_policy_with_a_lease_is_shown_the_arms_and_its_answer_reaches_the_loop(running):
    served, client, headers, token = running
    with policy(served, token) as (take, send):
        assert "has given grabber no lease" in take("waiting")["waiting"]
        assert served.parts.teleop.view.policies == ("grabber",)
        assert lend(client, headers).json()["policy"] == "grabber"
        shown = take("observation")["observation"]
        assert shown["t_ns"] == 1_000_000
        assert np.shape(shown["q"]) == np.shape(shown["pose"]) == (2, 7)
        np.testing.assert_allclose(shown["pose_ref"], POSES)
        assert shown["object_pose"] is None
        send(to=shown["number"], step_s=0.05, poses=[POSES, POSES])
        assert take("observation")["refused"] is None
        read, lease = chunk(served), target(served)["policy"]
        assert (read["job"], read["lease"], read["observed_ns"], read["count"]) == (1, lease, 1_000_000, 2)
        assert lease > 0
        np.testing.assert_allclose(read["pose"][1], POSES)
        # the clutch takes it back, and only a new lease gives it again
        assert say(client, headers, clutch=True).json()["policy"] is None
        assert (target(served)["policy"], target(served)["clutch_ns"] > 0) == (0, True)
        send(to=shown["number"] + 1, poses=[POSES])
        assert "no lease" in take("waiting")["waiting"]
        assert lend(client, headers).status_code == 200
        assert target(served)["policy"] > lease
        assert target(served)["clutch_ns"] == 0


def test_a_policy_that_ends_says_why_in_its_own_words_on_the_page_and_in_the_audit_trail(running):
    served, client, headers, token = running
    words = "ValueError: no such object (/lab/policy.py:12)"
    with policy(served, token) as (take, send):
        assert lend(client, headers).status_code == 200
        send(to=take("observation")["observation"]["number"], failed=words.replace(": ", ":\n \x1b"))
        assert "no lease" in take("waiting")["waiting"]
    assert words in served.parts.teleop.view.refusal
    wait_for(lambda: (Level.ERROR, f"grabber: the policy has ended: {words}") in [
        (event.level, event.text) for event in served.job_manager.authority.run_events()
    ])  # fmt: skip
    wait_for(lambda: words in (served.logs / "audit.jsonl").read_text())
    assert lend(client, headers).json()["refusal"] is None


def test_a_policy_is_shown_nothing_before_the_run_has_a_sample(running):
    """What the arms said while nothing ran is of another time, and nothing was asked of them."""
    served, client, headers, token = running
    push(served, 10_243_000_000, Mode.IDLE)
    with policy(served, token) as (take, _):
        assert lend(client, headers).json()["policy"] == "grabber"
        take("waiting")  # what was on its way
        assert "has not begun" in take("waiting")["waiting"]
        push(served, 1_000_000)
        assert take("observation")["observation"]["t_ns"] == 1_000_000


def test_a_policy_is_shown_the_newest_picture_of_each_camera_of_the_run(running):
    served, client, headers, token = running
    ring = PictureRing.create()
    served.job_manager.started("x.mcap", {"front": ring.name})
    for t_ns in (900_000, 1_000_000, 1_100_000):
        ring.write(t_ns, b"%d" % t_ns)
    wait_for(lambda: "front" in served.parts.watch.cameras())
    with policy(served, token) as (take, _):
        assert lend(client, headers).status_code == 200
        shown = take("observation")["observation"]["pictures"]
        assert shown == {"front": {"t_ns": 1_000_000, "jpeg": b64encode(b"1000000").decode()}}
    ring.close()


def test_answers_that_are_none_are_refused_with_the_reason_and_do_not_reach_the_loop(running):
    served, client, headers, token = running
    with policy(served, token) as (take, send):
        assert lend(client, headers).status_code == 200
        for wrong, said in (
            ({"poses": [[[float("nan")] * 7] * 2]}, "finite"), ({"poses": [POSES], "to": 0}, "answers observation 0"),
            ({}, "has poses, or joints"), ({"poses": [POSES] * 17}, "poses"), ({"poses": [POSES], "odd": 1}, "odd"),
            ({"poses": [[[0.0] * 7] * 2]}, "length one"), ({"joints": [POSES], "step_s": 9.0}, "step_s"),
        ):  # fmt: skip
            number = take("observation")["observation"]["number"]
            send(**({"to": number} | wrong))
            assert said in take("observation")["refused"]
            send(to=-1)
        assert served.mailbox.chunk_sequence == 0


def test_a_policy_that_is_done_or_gone_has_no_lease_any_more(running):
    served, client, headers, token = running
    with policy(served, token) as (take, send):
        assert lend(client, headers).status_code == 200
        send(to=take("observation")["observation"]["number"], finished=True)
        take("waiting")
        assert target(served)["policy"] == 0
        assert lend(client, headers).status_code == 200
        take("observation")
    wait_for(lambda: target(served)["policy"] == 0 and served.parts.teleop.view.policies == ())


class Holds:
    """What the example of LeRobot asks: the pads are to stay, by quaternions that are too long."""

    rate_hz = 50

    def actions(self, shown):
        return (np.array(shown["pose_ref"]) * [1, 1, 1, 2, 2, 2, 2]).reshape(1, 14)


def test_the_example_of_lerobot_leads_until_its_lease_is_over(running, lerobot_policy, capsys):
    served, client, headers, token = running
    with ThreadPoolExecutor(1) as pool:
        leads = pool.submit(asyncio.run, lerobot_policy["lead"](Holds(), served.base, token))
        wait_for(lambda: served.parts.teleop.view.policies == ("grabber",))
        assert lend(client, headers).status_code == 200
        wait_for(lambda: served.mailbox.chunk_sequence > 4)
        np.testing.assert_allclose(chunk(served)["pose"][0], POSES)
        assert lend(client, headers, None).status_code == 200
        assert leads.result(60) > 1
    assert "refused" not in capsys.readouterr().out
    wait_for(lambda: served.parts.teleop.view.policies == ())


def test_only_the_operator_who_has_control_gives_a_lease(running):
    served, client, headers, token = running
    bearer = {"authorization": f"Bearer {token}"}
    assert "has control" in client.post("/api/policy/lease", json={"to": "grabber"}, headers=bearer).json()["error"]
    assert "of its own" in lend(client, headers, client.get("/api/status").json()["holder"]).json()["error"]
    _, viewing = served.parts.sign_in.tokens.create("looker", Scope.VIEW)
    with pytest.raises(Exception, match="403"), policy(served, viewing):
        pass
    assert target(served)["policy"] == 0
