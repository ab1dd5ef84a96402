"""Playback: a second log as a ghost of the review's scene, and orders to play a log on the arms."""

import json

import numpy as np
import pytest

from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.log_folder.catalogue import Catalogue
from rtstack.loop.mailbox import TARGET
from rtstack.topics import TOPICS
from tests.support.console.client import socket, wait_for

MS = 1_000_000
VIEW = "a-page-of-mine"


def write_motion(path, first):
    """A log of a second in which joint 1 of both arms goes from `first` with 1 rad/s."""
    with open(path, "wb") as file:
        writer = McapWriter(file)
        writer.write_metadata("trial", {"object": "rice_box"})
        batches = {topic: np.zeros(1 if topic == "/events" else 1000, TOPICS[topic].record) for topic in TOPICS}
        for batch in batches.values():
            batch["t_ns"] = np.arange(len(batch)) * MS
        for side in ("left", "right"):
            batches[f"/{side}/arm"]["q"][:, 0] = first + np.arange(1000) * 1e-3
        writer.write(batches, {})
        writer.write_metadata("result", {})
        writer.close()


@pytest.fixture
def logs(served):
    """Ids of two logs."""
    write_motion(served.logs / "one.mcap", 0.0)
    write_motion(served.logs / "two.mcap", 10.0)
    return {entry.path.stem: entry.id for entry in Catalogue(served.logs).entries()}


def test_a_second_log_is_shown_as_a_ghost_at_the_same_moment_and_goes_again(served, logs):
    with served.signed_in() as (client, _):
        for log_id in logs.values():
            wait_for(lambda log_id=log_id: client.get(f"/api/logs/{log_id}").json()["done"])
        with socket(served, f"/api/logs/{logs['one']}/scrub?view={VIEW}", client) as cursor:

            def ask(**message):
                cursor.send(json.dumps(message))
                return json.loads(cursor.recv(timeout=60)), served.parts.review_scenes._poses.get(VIEW)

            both = f"{logs['two']}:0.2,{logs['one']}:0.5"
            answer, poses = ask(t=0.6, others=both, signals="left.q.1")  # what the first one had at 0.4 s
            assert [other["t"] for other in answer["others"]] == pytest.approx([0.4, 0.1], abs=1e-3)
            values = [answer["values"], *(other["values"] for other in answer["others"])]
            assert [value["left.q.1"] for value in values] == pytest.approx([0.6, 10.4, 0.1], abs=1e-3)
            np.testing.assert_allclose(poses.log.q[:, 0], 0.6, atol=1e-3)
            np.testing.assert_allclose(poses.ghost.q[:, 0], 10.4, atol=1e-3)
            answer, poses = ask(t=0.6, others=both, ghost=False)
            assert (len(answer["others"]), poses.ghost) == (2, None)
            answer, poses = ask(t=0.1, others=both)  # before its beginning: nothing of it is known
            assert poses.ghost.q is None
            answer, poses = ask(t=0.6)
            assert answer["others"] == []
            assert poses.ghost is None
            answer, _ = ask(t=0.6, others="0" * 32)
            assert "does not exist" in answer["error"]
            answer, _ = ask(t=0.6, others=f"{logs['two']}:1e300")
            assert "not ID:OFFSET" in answer["error"]


def armed(client, headers):
    for verb in ("take", "arm"):
        client.post(f"/api/{verb}", json={}, headers=headers).raise_for_status()


def test_a_log_is_ordered_to_be_played_at_a_speed_and_ended_softly_by_its_operator(served, logs):
    with served.signed_in() as (client, headers):
        order = {"log": logs["one"], "speed": 0.5}
        refused = client.post("/api/jobs/playback", json=order, headers=headers)
        assert (refused.status_code, "take control" in refused.json()["error"]) == (409, True)
        armed(client, headers)
        assert client.post("/api/playback/finish", json={}, headers=headers).status_code == 409
        answer = client.post("/api/jobs/playback", json=order, headers=headers)
        assert answer.status_code == 202
        assert answer.json()["job"]["title"] == "one.mcap at 0.5x"
        taken = served.job_manager.collect()[0].specification
        assert (taken.verb, taken.source, taken.speed) == ("playback", str(served.logs / "one.mcap"), 0.5)
        served.job_manager.started("playback.mcap")
        # the console learns a moment later that it runs; meanwhile the operator gives signs of life
        wait_for(
            lambda: (
                client.post("/api/beat", json={}, headers=headers)
                and client.post("/api/playback/finish", json={}, headers=headers).json() == {"finishing": True}
            )
        )
        target = np.zeros(1, TARGET)
        assert served.mailbox.read_target(target)
        assert (target["job"][0], target["finish"][0], target["clutch_ns"][0]) == (taken_number(client), 1, 0)


def taken_number(client):
    return client.get("/api/status").json()["job"]["number"]


@pytest.mark.parametrize(
    ("order", "status", "says"),
    [
        ({"log": "0" * 32}, 404, "no such log"),
        ({"log": "one", "speed": 0.05}, 422, "speed"),
        ({"log": "one", "speed": 4.5}, 422, "speed"),
        ({"log": "one", "speed": "fast"}, 422, "speed"),
        ({"speed": 1.0}, 422, "log"),
        ({"log": "one", "arms": "left"}, 422, "arms"),
    ],
)
def test_a_bad_order_is_refused_in_one_line(served, logs, order, status, says):
    with served.signed_in() as (client, headers):
        armed(client, headers)
        order = {**order, **({"log": logs["one"]} if order.get("log") == "one" else {})}
        answer = client.post("/api/jobs/playback", json=order, headers=headers)
        assert answer.status_code == status
        assert says in answer.json()["error"]
        assert "\n" not in answer.json()["error"]
        assert served.job_manager.status().job is None
