"""The console of a cell with one arm: nothing of the other one is asked for, shown or taken, and the API says so."""

import json
import time
from contextlib import contextmanager

import numpy as np
import pytest
from websockets.sync.client import connect

from console.live.feed import Feed
from console.live.watch import NEVER_S
from rtstack.access.tokens import Scope
from rtstack.log_folder.catalogue import Catalogue
from rtstack.loop.mailbox import CHUNK, TARGET
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, SIDES, Mode
from rtstack.trials.record import frames
from tests.support.console.client import arm, say, socket, wait_for
from tests.support.console.review_log import read, write_log
from tests.support.console.served_console import serve_console
from tests.support.one_arm import one_arm_file

POSE = [0.0, 0.35, 0.26, 1.0, 0.0, 0.0, 0.0]
ORDER = {"object": "rice_box"}


@pytest.fixture(params=SIDES)
def side(request):
    """The side of the arm that is there."""
    return request.param


@pytest.fixture
def other(side):
    """The side of the arm that is not there."""
    return SIDES[1 - SIDES.index(side)]


@pytest.fixture
def served(tmp_path, monkeypatch, side):
    """A console of a cell with one arm."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    logs = tmp_path / "logs"
    logs.mkdir()
    with serve_console(logs, one_arm_file(tmp_path, side)) as console:
        yield console


@contextmanager
def teleoperated(served, side):
    """A client with control, in whose teleoperation the arm says where it was told to be."""
    with served.signed_in() as (client, headers):
        arm(client, headers)
        assert client.post("/api/jobs/teleoperation", json=ORDER, headers=headers).status_code == 202
        served.job_manager.started("x.mcap")
        push(served, side)
        wait_for(lambda: served.parts.watch.command() is not None and served.parts.teleop.running)
        yield client, headers


def push(served, side, t_ns=1_000_000):
    sample, control = np.zeros(1, ARM_SAMPLE), np.zeros(1, CONTROL_SAMPLE)
    sample["O_T_EE"], sample["t_ns"] = np.eye(4), t_ns
    control["mode"], control["pose_ref"] = Mode.TELEOPERATION, POSE
    served.rings.pusher(f"/{side}/arm").push(sample)
    served.rings.pusher(f"/{side}/control").push(control)


def target(served):
    record = np.zeros(1, TARGET)
    assert served.mailbox.read_target(record)
    return record[0]


def shown(client, path):
    answer = client.get(path)
    assert answer.status_code == 200, answer.text
    return answer.text


def test_the_pages_name_this_arm_alone_and_offer_what_one_arm_can_do(served, side, other):
    with served.signed_in() as (client, _):
        for path in ("/", "/logs", "/headset", "/access", "/api"):
            page = shown(client, path)
            assert f'data-sides="{side}"' in page
            assert f"light-{side}" in page
            assert f"light-{other}" not in page
            for words in (f"{other} arm", "oth arms", "oth pads", "other arm", 'href="/trials"', 'href="/campaigns"'):
                assert words not in page, (path, words)
        page = shown(client, "/")
        for id in ("tab-demonstration", "tab-trial", "tab-training", "trial-card", "keys-side"):
            assert f'id="{id}"' not in page
        for words in ("put_down", 'data-motion="open"', 'name="coupling"', 'value="meet"', f"<option>{other}</option>"):
            assert words not in page
        for id in ("tab-hand", "tab-calibration", "guide", "practise", "record", "undo"):
            assert f'id="{id}"' in page
        assert f"<option>{side}</option>" in page


def test_the_live_view_is_of_this_arm(served, side, other):
    with served.signed_in() as (client, _), socket(served, "/live", client) as page:
        view = json.loads(page.recv(timeout=60))
        assert (view[other], view["places"], view["desk"]) == (None, None, [])
        assert view[side]["age_s"] == NEVER_S
        push(served, side)
        wait_for(lambda: served.parts.watch.view.places is not None)
        while (view := json.loads(page.recv(timeout=60)))["places"] is None:
            pass
        assert (len(view["places"]["pads"]), len(view["places"]["told"])) == (1, 1)
        assert view[side]["mode"] == "TELEOPERATION"
        assert view["state"]["held_n"] is None
    assert [len(each) for each in (served.parts.watch.q(), served.parts.watch.forces())] == [1, 1]


def test_what_takes_two_arms_is_refused_in_one_line(served, side):
    with served.signed_in() as (client, headers):
        arm(client, headers)
        trial = {"reference": "x", "object": "rice_box", "controller": "proposed"}
        plan = {"controllers": ["proposed"], "objects": ["rice_box"], "displacements_mm": "0"}
        sweep = {**plan, "reference": "x", "seeds": "0"}
        for path, body in (
            ("/api/jobs/demonstration", {"object": "rice_box"}),
            ("/api/jobs/move", {"motion": "put_down"}),
            ("/api/jobs/move", {"motion": "open"}),
            ("/api/jobs/preview", trial),
            ("/api/queue", {"trial": trial}),
            ("/api/queue/sweep", sweep),
            ("/api/queue/start", {}),
            ("/api/training", {"object": "rice_box"}),
            ("/api/campaigns", {"name": "quick"}),
            ("/api/plans", {**plan, "name": "mine"}),
        ):
            answer = client.post(path, json=body, headers=headers)
            assert answer.status_code == 409, (path, answer.text)
            line = answer.json()["error"]
            assert f"takes two arms, and the cell grab has the {side} one alone" in line, (path, line)
            assert "\n" not in line
        for path in ("/trials", "/campaigns"):
            assert "takes two arms" in client.get(path).text
        assert client.post("/api/jobs/move", json={"motion": "start"}, headers=headers).status_code == 202


def test_its_pose_reaches_the_mailbox_and_the_row_of_the_other_one_stays_empty(served, side, other):
    with teleoperated(served, side) as (client, headers):
        row, pose = SIDES.index(side), [0.02, *POSE[1:]]
        assert say(client, headers, clutch=True, pose={side: pose}).status_code == 200
        np.testing.assert_allclose(target(served)["pose"][row], pose)
        assert np.isnan(target(served)["pose"][1 - row]).all()
        say(client, headers, clutch=True, deflection={side: [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]})
        say(client, headers, clutch=True, deflection={side: [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]})
        assert target(served)["pose"][row][2] > pose[2]
        for step in range(10):  # after a pause of a busy machine the hand leads from where the arm is
            hand = [1.0 + 0.002 * step, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
            say(client, headers, clutch=True, hands={side: hand})
            time.sleep(0.01)
        assert POSE[0] < target(served)["pose"][row][0] <= pose[0] + 0.002 * 9 + 1e-9
        before = served.mailbox.target_sequence
        for kind, values in (("pose", POSE), ("hands", POSE), ("deflection", [1.0] + [0.0] * 5)):
            refused = say(client, headers, clutch=True, **{kind: {other: values}})
            assert refused.status_code == 409
            assert refused.json()["error"] == f"the cell grab has no {other} arm: leave `{other}` out"
        linked = say(client, headers, coupling="linked")
        assert linked.json()["error"] == "coupling linked takes two arms, and the cell has one: leave it separate"
        assert served.mailbox.target_sequence == before
        assert say(client, headers, coupling="separate").status_code == 200


def test_a_gizmo_moves_it(served, side):
    with teleoperated(served, side) as (client, headers):
        say(client, headers, clutch=True)
        grip = np.array(POSE)
        served.parts.teleop.drag(0, grip, "start")
        served.parts.teleop.drag(0, grip + np.eye(7)[0] * 0.02, "update")
        assert target(served)["pose"][SIDES.index(side)][0] == pytest.approx(0.02)


def test_a_policy_sees_and_leads_it(served, side):
    with teleoperated(served, side) as (client, headers):
        _, token = served.parts.sign_in.tokens.create("grabber", Scope.OPERATE)
        address = f"ws://127.0.0.1:{served.port}/api/policy?rate_hz=50"
        with connect(address, additional_headers={"authorization": f"Bearer {token}"}, proxy=None) as stream:
            assert "waiting" in json.loads(stream.recv(timeout=60))
            assert client.post("/api/policy/lease", json={"to": "grabber"}, headers=headers).status_code == 200
            while "observation" not in (said := json.loads(stream.recv(timeout=60))):
                pass
            seen = said["observation"]
            assert {key: np.shape(seen[key]) for key in ("q", "dq", "pose", "pose_ref", "force")} == {
                "q": (1, 7), "dq": (1, 7), "pose": (1, 7), "pose_ref": (1, 7), "force": (1, 3),
            }  # fmt: skip
            stream.send(json.dumps({"to": seen["number"], "poses": [[POSE, POSE]]}))
            said = json.loads(stream.recv(timeout=60))
            assert said["refused"] == "a chunk is (n, 1, 7) with n from 1 to 16, not (1, 2, 7)"
            stream.send(json.dumps({"to": said["observation"]["number"], "poses": [[POSE]]}))
            assert json.loads(stream.recv(timeout=60))["refused"] is None
    chunk, row = np.zeros(1, CHUNK), SIDES.index(side)
    assert served.mailbox.read_chunk(chunk)
    np.testing.assert_allclose(chunk["pose"][0, 0, row], POSE)
    np.testing.assert_allclose(chunk["pose"][0, 0, 1 - row], [0, 0, 0, 1, 0, 0, 0])


def test_the_live_feed_has_no_topic_of_the_other_one(served, side, other):
    cell = served.parts.cell
    feed = Feed(served.rings, frames(cell, next(iter(cell.objects))))
    topics = [channel["topic"] for channel in json.loads(feed.advertisement())["channels"]]
    assert f"/{side}/arm" in topics
    assert not [topic for topic in topics if topic.startswith(f"/{other}/")]
    push(served, side)
    feed.poll()


def test_its_log_is_reviewed_without_a_word_of_the_other_one(served, side, other):
    write_log(served.logs / "one.mcap", {"object": "rice_box"}, {"success": "true"}, sides=(side,))
    (entry,) = Catalogue(served.logs).entries()
    with served.signed_in() as (client, _):
        document = read(client, entry.id)
        assert f"/{side}/derived" in document["topics"]
        assert not [topic for topic in document["topics"] if topic.startswith(f"/{other}/")]
        assert list(document["modes"]) == [side]
        assert document["modes"][side]
        values = client.get(f"/api/logs/{entry.id}/values", params={"t": 0.5, "signals": f"{side}.pad_force"}).json()
        assert np.shape(values["q"]) == (1, 7)
        assert np.isfinite(values["values"][f"{side}.pad_force"])
        window = {"signals": f"{side}.pad_force,{side}.q.1", "start": 0.0, "end": 0.5}
        lines = client.get(f"/api/logs/{entry.id}/csv", params=window).text.splitlines()
        assert lines[0] == f"t_s,utc,{side}.pad_force,{side}.q.1"
        assert len(lines) > 400
        assert client.get(f"/api/logs/{entry.id}/figure", params={**window, "form": "svg"}).status_code == 200
        assert client.get(f"/api/logs/{entry.id}/series", params={**window, "width": 100}).status_code == 200
        assert client.get("/api/logs", params={"q": "one"}).json()[0]["id"] == entry.id
