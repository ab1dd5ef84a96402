"""Recordings over HTTP: extracted, accepted, offered to trials, thrown away."""

import re
import shutil
import time

import numpy as np
import pytest

from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial
from tests.support.console.client import arm, wait_for


@pytest.fixture
def recorded(served, demonstration):
    """A console with one recording; give it, a signed-in client, its headers and the recording's id."""
    shutil.copy(demonstration.path, served.logs / "a.mcap")
    with served.signed_in() as (client, headers):
        (row,) = client.get("/api/logs").json()
        yield served, client, headers, row["id"]


@pytest.mark.long
def test_a_recording_is_extracted_again_with_another_time_and_keeps_what_is_said(recorded):
    _, client, headers, log_id = recorded
    first = client.get(f"/api/recordings/{log_id}").json()
    uncut = {"from_s": None, "to_s": None}
    assert first["acceptance"] == {"name": "", "note": "", "verdict": "open", "nominal_impact_s": None, **uncut}
    detected_s = first["extraction"]["detected_impact_s"]
    later = client.get(f"/api/recordings/{log_id}", params={"nominal_impact_s": detected_s + 0.03}).json()
    assert later["extraction"]["nominal_impact_s"] == pytest.approx(detected_s + 0.03)
    assert later["extraction"]["velocity"] != first["extraction"]["velocity"]
    said = {"name": "<b>grab</b>", "note": "n", "verdict": "accepted", "nominal_impact_s": detected_s + 0.03, **uncut}
    assert client.post(f"/api/recordings/{log_id}", json=said, headers=headers).json() == said
    assert client.get(f"/api/recordings/{log_id}").json()["acceptance"] == said
    (row,) = client.get("/api/logs").json()
    assert (row["title"], row["object"]) == ("<b>grab</b>", "rice_box")


def test_a_part_of_a_recording_is_used_and_its_file_is_not_changed(recorded):
    served, client, headers, log_id = recorded
    before = (served.logs / "a.mcap").read_bytes()
    whole = client.get(f"/api/recordings/{log_id}").json()["extraction"]
    cut = {"from_s": 0.5, "to_s": 3.0}
    shown = client.get(f"/api/recordings/{log_id}", params=cut).json()["extraction"]
    assert (shown["begin_s"], shown["end_s"], shown["duration_s"]) == pytest.approx((0.5, 3.0, 2.5))
    assert shown["detected_impact_s"] == pytest.approx(whole["detected_impact_s"])  # times stay those of the recording
    assert shown["whole_t_s"] == whole["whole_t_s"]  # what is cut off is still drawn
    assert shown["t_s"] == pytest.approx(whole["t_s"])
    assert shown["velocity"]["left"]["recorded"] == whole["velocity"]["left"]["recorded"]
    said = {"verdict": "accepted", **cut}
    client.post(f"/api/recordings/{log_id}", json=said, headers=headers).raise_for_status()
    kept = client.get(f"/api/recordings/{log_id}").json()
    assert (kept["acceptance"]["from_s"], kept["extraction"]["end_s"]) == (0.5, pytest.approx(3.0))
    reference = prepare_trial(TrialSpecification(str(served.logs / "a.mcap")), served.parts.cell).reference
    assert reference.ticks == 2500
    assert reference.nominal_impact_s == pytest.approx(whole["detected_impact_s"] - 0.5)
    for wrong, word in (
        ({"from_s": 2.0, "to_s": 2.0}, "nothing is left"),
        ({"from_s": 2.0}, "no impact is in the part that is used: widen"),
    ):
        answer = client.post(f"/api/recordings/{log_id}", json={"verdict": "accepted", **wrong}, headers=headers)
        assert (answer.status_code, word in answer.json()["error"]) == (409, True)
    assert (served.logs / "a.mcap").read_bytes() == before


def test_a_page_need_not_wait_and_is_told_how_far_the_extraction_is(recorded):
    _, client, _, log_id = recorded
    shares = []
    while True:
        view = client.get(f"/api/recordings/{log_id}", params={"wait": False}).json()
        shares.append(view["share"])
        if view["extraction"] is not None:
            break
        time.sleep(0.02)
    assert shares == sorted(shares)
    assert (view["acceptance"]["verdict"], shares[-1]) == ("open", 1.0)
    assert any(0.0 < share < 1.0 for share in shares)


def test_a_recording_has_a_picture_of_its_forces_once_it_is_read(recorded):
    _, client, _, log_id = recorded
    for _ in range(600):
        answer = client.get(f"/api/recordings/{log_id}/thumbnail")
        if answer.status_code != 202:
            break
        time.sleep(0.1)
    assert (answer.status_code, answer.headers["content-type"]) == (200, "image/svg+xml")
    assert answer.text.count("<polyline") == 2
    heights = [float(point.split(",")[1]) for point in re.findall(r'points="([^"]+)"', answer.text)[0].split()]
    assert max(np.abs(np.diff(heights[80:110]))) < 5.0  # the box is held: no gap between two buckets
    highest = float(re.findall(r"<title>(\d+) N", answer.text)[0])
    assert highest > 30.0


def test_a_rejected_recording_is_not_offered_and_what_gives_no_reference_is_not_accepted(recorded):
    _, client, headers, log_id = recorded
    assert client.get("/api/logs").json()[0]["recording"]
    client.post(f"/api/recordings/{log_id}", json={"verdict": "rejected"}, headers=headers).raise_for_status()
    assert not client.get("/api/logs").json()[0]["recording"]
    answer = client.post(
        f"/api/recordings/{log_id}", json={"verdict": "accepted", "nominal_impact_s": 0.01}, headers=headers
    )
    assert answer.status_code == 409
    assert "from an end of the recording" in answer.json()["error"]
    assert client.get("/api/logs").json()[0]["decision"] == "rejected"


def test_what_trials_may_follow_is_kept_and_what_is_rejected_has_failed_unless_it_was_discarded(recorded):
    _, client, headers, log_id = recorded

    def verdict(of_the_recording):
        client.post(f"/api/recordings/{log_id}", json={"verdict": of_the_recording}, headers=headers).raise_for_status()
        return client.get("/api/logs").json()[0]["episode_verdict"]

    assert [verdict(each) for each in ("open", "rejected", "accepted", "rejected")] == [
        None,
        "failed",
        "kept",
        "failed",
    ]
    client.post(f"/api/logs/{log_id}/remarks", json={"verdict": "discard"}, headers=headers).raise_for_status()
    assert verdict("rejected") == "discard"


@pytest.mark.parametrize("said", [{"verdict": "good"}, {"nominal_impact_s": -1}, {"name": "x" * 81}, {"more": 1}])
def test_what_is_no_acceptance_is_one_line(recorded, said):
    _, client, headers, log_id = recorded
    answer = client.post(f"/api/recordings/{log_id}", json=said, headers=headers)
    assert answer.status_code == 422
    assert "\n" not in answer.json()["error"]


def test_a_discarded_recording_is_gone_with_what_was_said_and_nothing_else_can_be(recorded):
    served, client, headers, log_id = recorded
    assert client.post(f"/api/recordings/{log_id}/discard").status_code == 403
    client.post(f"/api/recordings/{log_id}", json={"name": "x"}, headers=headers)
    assert client.post("/api/recordings/0000/discard", headers=headers).status_code == 404
    arm(client, headers)
    client.post("/api/jobs/teleoperation", json={"object": "rice_box", "recorded": True}, headers=headers)
    served.job_manager.started("a.mcap")
    show(served)
    assert client.post(f"/api/recordings/{log_id}/discard", headers=headers).status_code == 409
    served.job_manager._change(log="b.mcap")
    show(served)
    assert client.post(f"/api/recordings/{log_id}/discard", headers=headers).json() == {"discarded": True}
    assert not list(served.logs.glob("a.mcap*"))


def show(served):
    """Let the console see the job manager's status."""
    status = served.job_manager.status()
    served.parts.watch.learn(status)
    wait_for(lambda: served.parts.watch.view.status == status)


def test_the_page_of_a_recording_is_for_recordings_only(recorded):
    served, client, _, log_id = recorded
    assert f'data-id="{log_id}"' in client.get(f"/recordings/{log_id}").text
    (served.logs / "b.mcap").write_bytes(b"not a log")
    other = next(row["id"] for row in client.get("/api/logs").json() if row["name"] == "b.mcap")
    for wrong in (other, "0000"):
        assert client.get(f"/recordings/{wrong}").status_code == 404
