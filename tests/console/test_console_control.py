"""Control of the robot through the HTTP interface and the live socket, against the real job manager and socket."""

import json
import time
from contextlib import closing

import httpx
import pytest

from console.live.control_request import ANSWER_S
from rtstack.live.client import RobotClient
from rtstack.live.protocol import JobState
from rtstack.safety.arming import LEASE_S
from tests.support.console.client import arm, socket, wait_for


class Clock:
    """the control authority's clock, which only the test moves; s."""

    def __init__(self, served):
        self.now_s, self._arming = time.monotonic(), served.job_manager.authority._arming
        self._arming._lease_s = LEASE_S
        served.job_manager.authority._clock = lambda: self.now_s

    def pass_without_a_sign(self):
        """Go on for longer than a lease."""
        self.now_s += 1.1 * LEASE_S

    def pass_until(self, sign):
        """Go on for nearly a lease, and wait until the operator's sign of life has come."""
        self.now_s += 0.9 * LEASE_S
        sign()
        wait_for(lambda: self._arming._alive_s == self.now_s)


@pytest.fixture
def clock(served):
    wait_for(lambda: served.parts.watch.view.status is not None)  # the console has just begun to ask
    return Clock(served)


def post(client, headers, verb, **body):
    return client.post(f"/api/{verb}", json=body, headers=headers)


def test_taking_arming_and_releasing_say_what_they_did(served):
    with served.signed_in() as (client, headers):
        status = post(client, headers, "take", operator="Zoë <b>K</b>").json()
        assert (status["holder"], status["phase"]) == ("Zoë <b>K</b>", "disarmed")
        since_s = status["since_s"]
        status = post(client, headers, "arm").json()
        assert (status["phase"], status["reason"]) == ("armed", None)
        assert since_s < status["since_s"] <= time.time()
        assert post(client, headers, "disarm").json()["phase"] == "disarmed"
        post(client, headers, "arm")
        status = post(client, headers, "release").json()
        assert (status["holder"], status["phase"]) == (None, "disarmed")
    zoe = "Zoë <b>K</b>"
    done = [(act, zoe) for act in ("take", "arm", "disarm", "arm", "release")]
    assert served.trail() == [("sign in", "operator 1"), *done]


def test_a_second_operator_is_refused_with_the_name_and_may_take_over(served):
    with served.signed_in() as (client, headers):
        cookies, others = served.second_session()
        post(client, headers, "take", operator="anna")
        with httpx.Client(base_url=served.base, cookies=cookies, trust_env=False, timeout=60.0) as second:
            answer = post(second, others, "take", operator="ben")
            assert answer.status_code == 409
            assert answer.json()["error"].startswith("anna has control")
            for verb, order in (
                ("arm", {}), ("release", {}), ("beat", {}), ("take", {"operator": "ben", "over_from": "carla"}),
                ("jobs/demonstration", {"object": "parcel"}),
            ):  # fmt: skip
                answer = post(second, others, verb, **order)
                assert answer.status_code == 409
                assert "anna has control" in answer.json()["error"]
            answer = post(second, others, "take", operator="anna")
            assert answer.status_code == 409
            assert "another session calls itself anna" in answer.json()["error"]
            post(client, headers, "arm")
            status = post(second, others, "take", operator="ben", over_from="anna").json()
            assert (status["holder"], status["phase"]) == ("ben", "disarmed")
            wait_for(lambda: client.get("/api/status").json()["holder"] == "ben")
            answer = post(client, headers, "arm")
            assert answer.status_code == 409
            assert "ben has control" in answer.json()["error"]
            line = next(line for line in client.get("/api/audit").json() if line["action"] == "takeover")
    assert (line["operator"], line["text"]) == ("ben", "ben took over from anna")


@pytest.mark.parametrize("body", [{"operator": ""}, {"operator": "a\nb"}, {"operator": 3}, {"name": "anna"}, []])
def test_a_bad_name_is_one_line_that_names_the_key(served, body):
    with served.signed_in() as (client, headers):
        answer = client.post("/api/take", json=body, headers=headers)
        assert answer.status_code == 422
        assert "\n" not in answer.json()["error"]
        assert client.get("/api/status").json()["holder"] is None


def test_a_program_keeps_its_lease_by_beats_and_loses_it_without(served, clock):
    def beat():
        assert post(client, headers, "beat").status_code == 200

    def nobody():
        clock.pass_without_a_sign()
        return client.get("/api/status").json()["holder"] is None

    with served.signed_in() as (client, headers):
        assert post(client, headers, "beat").status_code == 409
        arm(client, headers)
        for _ in range(3):
            clock.pass_until(beat)
        assert client.get("/api/status").json()["phase"] == "armed"
        wait_for(nobody)
        assert client.get("/api/status").json()["phase"] == "disarmed"
    assert served.trail()[-1] == ("lost", "operator 1")


def test_a_page_keeps_its_lease_by_answering_what_it_is_sent(served, clock):
    def answer():
        assert json.loads(page.recv(timeout=60))["you"] == "operator 1"
        page.send("beat")

    def nobody():  # a page that receives and does not answer is no operator
        clock.pass_without_a_sign()
        page.send("hello")
        return json.loads(page.recv(timeout=60))["status"]["holder"] is None

    with served.signed_in() as (client, headers):
        arm(client, headers)
        with socket(served, "/live", client) as page:
            for _ in range(3):
                clock.pass_until(answer)
            assert client.get("/api/status").json()["phase"] == "armed"
            wait_for(nobody)


def test_stop_needs_no_lease_disarms_and_is_remembered_with_its_name(served):
    with served.signed_in() as (client, headers), closing(RobotClient(served.parts.client._path)) as other:
        other.take("ben")
        other.arm("ben")
        assert post(client, headers, "stop").status_code == 200
        assert served.mailbox.stop_requested
        wait_for(lambda: ("stop", "operator 1") in served.trail())
        assert other.status().phase == "disarmed"
        assert other.status().holder == "ben"


def test_a_stop_holds_until_somebody_arms_again(served):
    with served.signed_in() as (client, headers):
        arm(client, headers)
        served.mailbox.request_stop()
        answer = client.post("/api/jobs/demonstration", json={"object": "parcel"}, headers=headers)
        assert answer.status_code == 409
        assert "arm them first" in answer.json()["error"]
        assert post(client, headers, "arm").json()["phase"] == "armed"
        assert not served.mailbox.stop_requested
        client.post("/api/jobs/demonstration", json={"object": "parcel"}, headers=headers)
        post(client, headers, "stop")
        served.job_manager.started("x.mcap")
        assert client.get("/api/status").json()["job"]["state"] == JobState.STOPPING


def test_stop_reaches_the_loop_while_the_robot_process_does_not_answer(served):
    with served.signed_in() as (client, headers):
        served.service.close()
        assert post(client, headers, "stop").status_code == 200
    assert served.mailbox.stop_requested


def test_a_recovery_is_for_faults_and_not_while_a_job_runs(served):
    with served.signed_in() as (client, headers):
        answer = post(client, headers, "recover")
        assert answer.status_code == 409
        assert "nothing to recover from" in answer.json()["error"]
        arm(client, headers)
        client.post("/api/jobs/demonstration", json={"object": "parcel"}, headers=headers)
        answer = post(client, headers, "recover")
        assert answer.status_code == 409
        assert "is running" in answer.json()["error"]


def test_the_console_gives_a_sign_of_life_by_itself(served):
    wait_for(lambda: served.mailbox.console_beat_ns > 0)
    first_ns = served.mailbox.console_beat_ns
    wait_for(lambda: served.mailbox.console_beat_ns > first_ns)
    assert served.mailbox.console_beat_ns <= time.monotonic_ns()


def test_a_request_for_control_is_answered_by_its_holder_alone(served):
    cookies, other = served.second_session()
    asks = {"cookies": cookies, "headers": other, "trust_env": False, "timeout": 60.0}
    with served.signed_in() as (client, headers):

        def ask():
            return httpx.post(f"{served.base}/api/request", json={"operator": "bob"}, **asks)

        assert "no operator has control" in ask().json()["error"]
        post(client, headers, "take", operator="ada")
        assert post(client, headers, "request").status_code == 409  # of oneself
        assert post(client, headers, "request/give").status_code == 409  # no request
        assert ask().json()["holder"] == "ada"
        asker = "bob"
        assert httpx.post(f"{served.base}/api/request/give", json={}, **asks).status_code == 409
        with closing(socket(served, "/live", client)) as live:
            assert json.loads(live.recv())["request"] == {
                "operator": asker, "holder": "ada", "kept": False, "silent": False,
            }  # fmt: skip
        post(client, headers, "request/keep")
        assert served.parts.request.view("ada").kept
        ask()
        served.parts.request._clock = lambda: time.monotonic() + ANSWER_S
        assert served.parts.request.view("ada").silent
        assert post(client, headers, "request/give").json()["holder"] == asker
        assert served.parts.request.view(asker) is None
    assert ("takeover", asker) in served.trail()
