"""Orders through the HTTP interface, against the real job manager and socket."""

import httpx
import pytest

from tests.support.console.client import arm


def test_an_order_is_taken_once_and_the_second_says_why_not(served):
    with served.signed_in() as (client, headers):
        arm(client, headers)
        order = {"object": "parcel", "variation": 3, "seed": 7, "law_inertia": "M"}
        answer = client.post("/api/jobs/demonstration", json=order, headers=headers)
        assert answer.status_code == 202
        assert answer.json()["job"]["title"] == "parcel, variation 3, seed 7"
        taken = served.job_manager.collect()[0].specification
        assert (taken.object, taken.variation, taken.seed, taken.law_inertia) == ("parcel", 3, 7, "M")
        second = client.post("/api/jobs/demonstration", json=order, headers=headers)
        assert second.status_code == 409
        assert "running" in second.json()["error"]


@pytest.mark.parametrize(
    ("order", "key"),
    [
        ({"object": "parcel", "variation": -1}, "variation"),
        ({"object": "parcel", "seed": 2**40}, "seed"),
        ({"object": "parcel", "colour": "red"}, "colour"),
        ({"object": "../parcel"}, "object"),
        ([], "the request"),
    ],
)
def test_a_bad_order_is_one_line_that_names_the_key(served, order, key):
    with served.signed_in() as (client, headers):
        answer = client.post("/api/jobs/demonstration", json=order, headers=headers)
        assert answer.status_code == 422
        assert answer.json()["error"].startswith(key)
    assert served.job_manager.status().job is None


def test_an_order_needs_control_and_arming_in_this_order(served):
    order = {"object": "parcel"}
    with served.signed_in() as (client, headers):
        for missing, verb in (("take control first", "take"), ("arm them first", "arm")):
            answer = client.post("/api/jobs/demonstration", json=order, headers=headers)
            assert answer.status_code == 409
            assert missing in answer.json()["error"]
            assert missing in client.get("/api/status").json()["refusal"]
            client.post(f"/api/{verb}", json={}, headers=headers)
        assert client.get("/api/status").json()["refusal"] is None
        answer = client.post("/api/jobs/demonstration", json=order, headers=headers)
        assert answer.status_code == 202
        assert answer.json()["phase"] == "moving"


def test_an_object_that_the_cell_does_not_have_is_refused_with_the_ones_it_has(served):
    with served.signed_in() as (client, headers):
        arm(client, headers)
        answer = client.post("/api/jobs/demonstration", json={"object": "piano"}, headers=headers)
        assert answer.status_code == 409
        assert "rice_box" in answer.json()["error"]


def test_a_trial_needs_a_recording_and_finite_numbers(served):
    with served.signed_in() as (client, headers):
        order = {"reference": "0" * 32, "object": "rice_box"}
        answer = client.post("/api/jobs/trial", json=order, headers=headers)
        assert answer.status_code == 404
        assert "recording" in answer.json()["error"]
        for bad in ('{"reference": "a", "object": "rice_box", "displacement_mm": NaN}', '{"reference": ', "null"):
            content = {"content-type": "application/json"}
            answer = client.post("/api/jobs/trial", content=bad, headers={**headers, **content})
            assert answer.status_code == 422
            assert "\n" not in answer.json()["error"]
        unknown = client.post("/api/jobs/trial", json={**order, "controller": "best"}, headers=headers)
        assert unknown.status_code == 422


def test_a_robot_process_that_is_gone_is_one_line(served):
    with served.signed_in() as (client, _):
        served.service.close()
        served.parts.client.close()
        answer = client.get("/api/status")
        assert answer.status_code == 503
        assert "robot process" in answer.json()["error"]
        assert httpx.codes.is_success(client.get("/api/logs").status_code)


def test_a_motion_from_where_the_arms_are_is_an_order_like_the_others(served):
    with served.signed_in() as (client, headers):
        refused = client.post("/api/jobs/move", json={"motion": "open"}, headers=headers)
        assert (refused.status_code, "take control first" in refused.json()["error"]) == (409, True)
        arm(client, headers)
        assert client.post("/api/jobs/move", json={"motion": "dance"}, headers=headers).status_code == 422
        answer = client.post("/api/jobs/move", json={"motion": "put_down"}, headers=headers)
        assert (answer.status_code, answer.json()["job"]["title"]) == (202, "put it down")
