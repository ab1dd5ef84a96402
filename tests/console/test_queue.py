"""The queue of trials over HTTP, against the real job manager and socket; the test acts as the robot."""

import dataclasses
import json
import shutil
import threading
import time

import httpx
import pytest

from console.orders import TrialOrder
from console.queue.entry import Entry, EntryState, QueueOrder
from console.queue.queue import FILE_NAME, INTERRUPTED, MAX_ENTRIES, Queue, load_entries, time_left_s
from console.refused import Refused
from rtstack.cells import default_cell_file
from rtstack.live.protocol import JobState
from rtstack.planning import GrabPlan, plan_grab
from rtstack.planning.file import write_plan
from tests.support.console.client import arm, wait_for


class Operator:
    """A program that has control."""

    def __init__(self, served, client, headers):
        self.served, self.client, self.headers = served, client, headers

    def post(self, path, **body):
        return self.client.post(f"/api/{path}", json=body, headers=self.headers)

    def queue(self):
        return self.client.get("/api/queue").json()

    def add(self, reference, repetitions=1, **trial):
        return self.post(
            "queue", trial={"reference": reference, "object": "rice_box", **trial}, repetitions=repetitions
        )

    def states(self):
        return [entry["state"] for entry in self.queue()["entries"]]

    def order(self):
        """Return what the queue has ordered, once it has."""
        taken = []
        wait_for(lambda: (self.queue() and taken.append(self.served.job_manager.collect()[0])) or taken[-1] is not None)
        self.served.job_manager.started("trial.mcap")
        return taken[-1].specification

    def end(self, state=JobState.DONE, success=True, reason=None):
        self.served.job_manager.finished(state, reason, success, "trial.mcap")


@pytest.fixture
def operator(served, demonstration):
    """An armed operator, with a recording and a log that is none."""
    shutil.copy(demonstration.path, served.logs / "ref.mcap")
    (served.logs / "foreign.mcap").write_bytes(b"no log")
    wait_for(lambda: served.parts.watch.view.status is not None)
    gone = threading.Event()

    def live():
        while not gone.wait(0.1):
            served.parts.heartbeats.note("operator 1")  # a busy machine takes longer than a lease between two questions

    with served.signed_in() as (client, headers):
        thread = threading.Thread(target=live)
        thread.start()
        arm(client, headers)
        yield Operator(served, client, headers)
        gone.set()
        thread.join()


@pytest.fixture
def reference(operator):
    return next(row["id"] for row in operator.client.get("/api/logs").json() if row["name"] == "ref.mcap")


def test_repetitions_run_in_order_each_with_the_next_seed_and_leave_the_time_they_took(operator, reference):
    answer = operator.add(reference, 3, controller="contact_completion", seed=7, reaction="stop", displacement_mm=-15)
    assert answer.status_code == 201
    assert [entry["trial"]["seed"] for entry in answer.json()["entries"]] == [7, 8, 9]
    assert (answer.json()["running"], answer.json()["time_left_s"]) == (False, None)
    time.sleep(0.3)  # three looks of the runner: what nobody has started does not begin
    assert operator.served.job_manager.collect()[0] is None
    assert operator.post("queue/start").json()["operator"] == "operator 1"
    for seed in (7, 8, 9):
        order = operator.order()
        assert (order.seed, order.controller, order.reaction) == (seed, "contact_completion", "stop")
        assert order.displacement_mm == -15.0
        assert operator.states()[seed - 7] == "running"
        operator.end()
    wait_for(lambda: not operator.queue()["running"])
    queue = operator.queue()
    assert [entry["state"] for entry in queue["entries"]] == ["succeeded"] * 3
    assert all(entry["duration_s"] > 0.0 for entry in queue["entries"])
    assert (queue["reason"], queue["time_left_s"]) == ("all of it is done", 0.0)


def test_the_laws_inertia_goes_with_a_trial_a_sweep_and_the_queues_file_to_the_robot(operator, reference):
    pages = [operator.client.get(path).text for path in ("/", "/trials")]
    assert [page.count('<select name="law_inertia">') for page in pages] == [2, 1]  # demonstration and trial; sweep
    assert all(page.count("the cell's (M+B_theta)") == page.count('<option value="M">') for page in pages)
    operator.add(reference, law_inertia="M")
    operator.add(reference, law_inertia=None)  # as the page sends it
    sweep = {"reference": reference, "objects": ["rice_box"], "seeds": "3", "law_inertia": "M+B_theta"}
    assert operator.post("queue/sweep", **sweep).status_code == 201
    asked = ["M", None, "M+B_theta"]
    assert [entry["trial"]["law_inertia"] for entry in operator.queue()["entries"]] == asked
    assert [entry.trial.law_inertia for entry in load_entries(operator.served.logs / FILE_NAME)] == asked
    operator.post("queue/start")
    for law in asked:
        assert operator.order().law_inertia == law
        operator.end()


@pytest.mark.parametrize(
    ("state", "success", "past_failures", "goes_on", "why"),
    [
        (JobState.DONE, False, False, False, "a trial failed: it slipped"),
        (JobState.DONE, False, True, True, None),
        (JobState.FAILED, None, True, False, "a trial failed: it slipped"),
        (JobState.STOPPED, False, True, False, "a trial was stopped: it slipped"),
    ],
)
def test_it_pauses_at_what_went_wrong(operator, reference, state, success, past_failures, goes_on, why):
    operator.add(reference, 2)
    operator.post("queue/start", past_failures=past_failures)
    operator.order()
    operator.end(state, success, "it slipped")
    if goes_on:
        assert operator.order().seed == 1
    wait_for(lambda: operator.states()[0] in ("failed", "stopped"))
    queue = operator.queue()
    assert (queue["running"], queue["reason"]) == (goes_on, why)
    assert queue["entries"][0]["reason"] == "it slipped"
    assert queue["entries"][1]["state"] == ("running" if goes_on else "waiting")


def test_a_fault_pauses_whatever_was_asked_and_real_arms_wait_for_a_person(operator, reference):
    operator.add(reference, 3)
    operator.post("queue/start", past_failures=True)
    operator.order()
    job_manager = operator.served.job_manager
    job_manager._description = dataclasses.replace(job_manager._description, simulated=False)
    operator.end()
    wait_for(lambda: "put the object in its place" in str(operator.queue()["reason"]))
    operator.post("queue/start", past_failures=True)
    operator.order()
    job_manager.authority.fault("the arm hit its stop")
    operator.end(JobState.DONE, False, "safety stop")
    wait_for(lambda: operator.queue()["reason"] == "there is a fault: the arm hit its stop")
    answer = operator.post("queue/start")
    assert answer.status_code == 409
    assert "recover first" in answer.json()["error"]


@pytest.mark.parametrize("how", ["release", "disarm", "takeover"])
def test_it_pauses_where_its_operator_no_longer_has_the_armed_robot(operator, reference, how):
    operator.add(reference, 2)
    operator.post("queue/start")
    operator.order()
    if how == "takeover":
        operator.end()  # nobody takes over what moves
        operator.served.job_manager.authority.take("ben", over_from="operator 1")
        operator.served.job_manager.authority.arm("ben")
    else:
        operator.post(how)
        operator.end(JobState.STOPPED, False, "stop requested by the operator")
    wait_for(lambda: not operator.client.get("/api/queue").json()["running"])
    assert operator.served.parts.queue.next() is not None
    time.sleep(0.3)
    assert operator.served.job_manager.collect()[0] is None
    if how == "takeover":
        assert operator.served.parts.queue.view().reason == "operator 1 no longer has control"


def test_only_who_has_the_armed_robot_fills_and_starts_it_and_who_may_operate_pauses_and_stops_it(operator, reference):
    served = operator.served
    cookies, headers = served.second_session()
    operator.add(reference, 2)
    first = operator.queue()["entries"][0]["id"]
    with httpx.Client(base_url=served.base, cookies=cookies, trust_env=False, timeout=60.0) as second:
        ben = Operator(served, second, headers)
        trial = {"reference": reference, "object": "rice_box"}
        for path, body in (
            ("queue", {"trial": trial}), ("queue/start", {}), ("queue/clear", {}), (f"queue/{first}/remove", {}),
            (f"queue/{first}/cancel", {}), (f"queue/{first}/move", {"to": 1}),
        ):  # fmt: skip
            answer = ben.post(path, **body)
            assert (answer.status_code, answer.json()["error"].split(" has")[0]) == (409, "operator 1"), path
        assert second.post("/api/queue/start", json={}).status_code == 403  # without the session's word
        operator.post("queue/start")
        operator.order()
        assert ben.post("queue/cancel").json()["running"] is False
        assert served.mailbox.stop_requested
    assert operator.queue()["reason"] == "operator 2 cancelled the trial that ran"
    operator.end(JobState.STOPPED, False, "stop requested by the operator")
    wait_for(lambda: operator.states() == ["stopped", "waiting"])
    answer = operator.post("queue/start")
    assert answer.status_code == 409
    assert "arm them first" in answer.json()["error"]


def test_entries_move_are_cancelled_and_removed(operator, reference):
    operator.add(reference, 4)
    ids = [entry["id"] for entry in operator.queue()["entries"]]
    operator.post(f"queue/{ids[3]}/move", to=0)
    operator.post(f"queue/{ids[0]}/move", to=99)
    operator.post(f"queue/{ids[1]}/cancel")
    assert [entry["id"] for entry in operator.queue()["entries"]] == [ids[3], ids[1], ids[2], ids[0]]
    answer = operator.post(f"queue/{ids[1]}/move", to=0)
    assert (answer.status_code, answer.json()["error"]) == (
        409, "it is cancelled: only what waits can be moved or cancelled",
    )  # fmt: skip
    for what, body in (("remove", {}), ("cancel", {}), ("move", {"to": 0})):
        answer = operator.post(f"queue/0123456789abcdef/{what}", **body)
        assert (answer.status_code, answer.json()["error"][:22]) == (404, "there is no such entry")
    assert operator.post("queue/..%2F..%2Fetc/remove").status_code in (404, 422)
    operator.post(f"queue/{ids[2]}/remove")
    operator.post("queue/start")
    assert operator.order().seed == 3
    answer = operator.post(f"queue/{ids[3]}/remove")
    assert answer.json()["error"] == "it is running: cancel it first"
    assert [e["state"] for e in operator.post("queue/clear", finished_only=True).json()["entries"]] == [
        "running", "waiting",
    ]  # fmt: skip
    assert len(operator.post("queue/clear", finished_only=False).json()["entries"]) == 1


def test_a_bad_value_is_one_line_and_nothing_is_added(operator, reference):
    for change, status, says in (
        ({"object": "piano"}, 409, "object: the cell has no piano"),
        ({"controller": "best"}, 422, "trial.controller"),
        ({"reaction": "flee"}, 422, "trial.reaction"),
        ({"law_inertia": "M + B_theta"}, 422, "trial.law_inertia"),
        ({"displacement_mm": 1e9}, 422, "trial.displacement_mm"),
        ({"seed": 2**32 - 1}, 409, "seed: the last repetition would have"),
        ({"reference": "0" * 32}, 404, "there is no such recording or plan"),
    ):
        answer = operator.add(**{"reference": reference, "repetitions": 2, **change})
        assert (answer.status_code, answer.json()["error"].startswith(says)) == (status, True), answer.json()
        assert "\n" not in answer.json()["error"]
    assert operator.add(reference, 0).status_code == 422
    assert operator.queue()["entries"] == []


@pytest.fixture(scope="module")
def plan(cell, tmp_path_factory):
    """A planned grab, made before anybody has to keep control: it may take longer than a lease."""
    path = tmp_path_factory.mktemp("plan") / "plan.mcap"
    write_plan(path, plan_grab(cell, "rice_box", GrabPlan()), cell, default_cell_file())
    return path


def test_a_plan_may_be_followed_and_what_is_no_reference_or_was_rejected_may_not(plan, operator, reference):
    shutil.copy(plan, operator.served.logs)
    rows = {row["name"]: row for row in operator.client.get("/api/logs").json()}
    assert (rows["plan.mcap"]["recording"], rows["plan.mcap"]["outcome"]) == (True, "planned")
    assert operator.add(rows["plan.mcap"]["id"]).status_code == 201
    answer = operator.add(rows["foreign.mcap"]["id"])
    assert (answer.status_code, answer.json()["error"]) == (
        409, "no trial may follow this log; choose an accepted recording or a plan",
    )  # fmt: skip
    operator.add(reference)
    operator.post(f"recordings/{reference}", verdict="rejected")
    operator.post("queue/start")
    assert operator.order().reference.endswith("plan.mcap")
    operator.end()
    wait_for(lambda: "no trial may follow this log" in str(operator.queue()["reason"]))
    assert operator.states() == ["succeeded", "waiting"]


def trial(reference="a", seed=0):
    return TrialOrder(reference=reference, object="rice_box", seed=seed)


def test_a_restart_finds_the_queue_paused_and_what_ran_is_not_run_again(tmp_path):
    file = tmp_path / "queue.json"
    queue = Queue(file)
    queue.add(QueueOrder(trial(), 3), "reference")
    queue.start("anna", False)
    assert queue.claim(queue.view().entries[0].id, "anna")
    assert not queue.claim(queue.view().entries[2].id, "anna")  # it is not its turn
    again = Queue(file)
    view = again.view()
    assert [entry.state for entry in view.entries] == ["stopped", "waiting", "waiting"]
    assert (view.entries[0].reason, view.running) == (INTERRUPTED, False)
    assert again.next() == view.entries[1]
    with pytest.raises(Refused, match="room for"):
        assert not [again.add(QueueOrder(trial(), 200), "") for _ in range(4)]
    assert len(again.view().entries) == len(Queue(file).view().entries) <= MAX_ENTRIES
    file.write_text(json.dumps([{"id": 1}]))
    with pytest.raises(Refused, match="remove the file to begin with an empty queue"):
        Queue(file)


def test_a_disk_that_is_full_changes_nothing_that_a_person_asks_for_and_hides_nothing_that_happened(tmp_path):
    queue = Queue(tmp_path / "queue.json")
    queue.add(QueueOrder(trial()), "")
    entry = queue.view().entries[0]
    (tmp_path / "queue.json").unlink()
    (tmp_path / "queue.json").mkdir()  # as unwritable as a full disk, for root too
    with pytest.raises(Refused, match="cannot be written"):
        queue.add(QueueOrder(trial()), "")
    assert queue.view().entries == (entry,)
    queue.start("anna", False)
    with pytest.raises(Refused):
        queue.claim(entry.id, "anna")
    assert queue.running() is None  # it does not begin where that cannot be kept
    with pytest.raises(Refused):
        queue.note(entry.id, state=EntryState.SUCCEEDED)
    assert queue.view().entries[0].state is EntryState.SUCCEEDED


def test_the_time_left_comes_from_trials_of_the_same_reference():
    def entry(reference, state, **more):
        return Entry(reference, trial(reference), "", state=state, **more)

    measured = [
        entry("a", EntryState.SUCCEEDED, duration_s=10.0), entry("a", EntryState.FAILED, duration_s=14.0),
        entry("b", EntryState.SUCCEEDED, duration_s=30.0), entry("a", EntryState.STOPPED, duration_s=1.0),
    ]  # fmt: skip
    waiting = [entry("a", EntryState.RUNNING, began_s=95.0), entry("a", EntryState.WAITING)]
    assert time_left_s(measured + waiting, 100.0) == pytest.approx(7.0 + 12.0)
    assert time_left_s([*measured, entry("c", EntryState.WAITING)], 100.0) == pytest.approx(18.0)
    assert time_left_s(waiting, 100.0) is None
    assert time_left_s(measured, 100.0) == 0.0


def test_a_sweep_is_every_combination_and_runs_the_controllers_of_a_place_one_after_the_other(operator, reference):
    order = {
        "reference": reference, "objects": ["rice_box"], "controllers": ["proposed", "no_interim"],
        "displacements_mm": "-20:20:20", "seeds": "0; 7",
    }  # fmt: skip
    assert operator.post("queue/sweep/size", **order).json() == {"trials": 12, "room": MAX_ENTRIES}
    assert operator.queue()["entries"] == []
    answer = operator.post("queue/sweep", **order)
    assert answer.status_code == 201
    trials = [entry["trial"] for entry in answer.json()["entries"]]
    found = [(trial["displacement_mm"], trial["seed"], trial["controller"]) for trial in trials]
    assert found == [(y, seed, name) for y in (-20.0, 0.0, 20.0) for seed in (0, 7) for name in order["controllers"]]
    operator.post("queue/start")
    assert operator.order().displacement_mm == -20.0


def test_a_sweep_that_cannot_be_is_one_line_that_names_its_field_and_adds_nothing(operator, reference):
    for change, status, says in (
        ({"displacements_mm": "-60:x:60"}, 422, 'displacements_mm: "-60:x:60" is not a list: write -12.5, 5 or'),
        ({"displacements_mm": "-12,5"}, 422, 'displacements_mm: "-12,5" is not a list: write -12.5, 5 or -60:10:60'),
        ({"displacements_mm": "60:10:-60"}, 422, "displacements_mm: 60:10:-60: steps of 10 do not lead from 60 to -60"),
        ({"displacements_mm": "0:0:5"}, 422, "displacements_mm: 0:0:5: steps of 0"),
        ({"displacements_mm": "-1e6"}, 422, "displacements_mm: -1e+06 is beyond 1000"),
        ({"displacements_mm": "0:1e-9:900"}, 422, "displacements_mm: 0:1e-9:900: more than 500 values"),
        ({"displacements_mm": " , "}, 422, "displacements_mm: give a number"),
        ({"yaws_deg": "nan"}, 422, 'yaws_deg: "nan" is not a list'),
        ({"seeds": "0.5"}, 422, "seeds: 0.5: give whole numbers from 0 on"),
        ({"controllers": ["best"]}, 422, "controllers.0"),
        ({"controllers": []}, 422, "controllers"),
        ({"objects": ["rice_box", "piano"]}, 409, "objects: the cell has no piano"),
        ({"seeds": "0:499", "displacements_mm": "0, 1"}, 409, "these are 1000 trials, and the queue has room for 500"),
    ):
        answer = operator.post("queue/sweep", **{"reference": reference, "objects": ["rice_box"], **change})
        assert (answer.status_code, answer.json()["error"].startswith(says)) == (status, True), answer.json()
        assert "\n" not in answer.json()["error"]
    assert operator.queue()["entries"] == []
