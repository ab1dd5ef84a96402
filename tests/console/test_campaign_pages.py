"""Campaigns over HTTP: a real one of two trials, cancelled, resumed and looked at; only its own ids lead to it."""

import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import httpx
import psutil
import pytest

from console.campaigns import campaigns, folder
from console.campaigns.campaigns import NICENESS
from console.routes.campaigns import REPORT_POLICY
from rtstack.cli import stack_operator
from rtstack.experiments import progress, report, store
from rtstack.experiments.registry import plan_file
from rtstack.live.client import RobotClient
from tests.support.campaigns import two_controllers
from tests.support.console.client import arm
from tests.support.console.stack import Stack

PATIENCE_S = 240.0
NO_CONTEXT = "0" * 16


@pytest.fixture
def plan(tmp_path):
    return two_controllers(tmp_path / "small.toml", -30.0)


def until(client, address, reached):
    """Ask until what is said is as wanted; return it."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        said = client.get(address).json()
        if reached(said):
            return said
        assert time.monotonic() < deadline, said
        assert said["state"] not in ("failed", "interrupted", "finished"), said["message"]
        time.sleep(0.2)


def test_a_campaign_is_cancelled_resumed_and_shown_with_its_figures_report_results_and_logs(served, plan):
    with served.signed_in() as (client, headers):
        campaign = served.parts.campaigns.start(str(plan), False, 1, NICENESS)
        address = f"/api/campaigns/{campaign.id}"
        (child,) = [each for each in psutil.Process().children() if "rtstack.cli.child" in each.cmdline()]
        assert client.post("/api/campaigns", json={"name": "reference-spreading"}, headers=headers).status_code == 409
        until(client, address, lambda said: said["total"])  # recording: both trials take less than a stall
        assert child.nice() == min(19, NICENESS + os.nice(0))
        assert all(worker.nice() >= child.nice() for worker in child.children(recursive=True))
        said = client.post(f"{address}/cancel", headers=headers).json()
        assert said["state"] == "ending"
        said = until(client, address, lambda said: said["state"] == "interrupted")
        assert not child.is_running()
        assert said["report"] is False
        assert client.get(f"{address}/report").status_code == 404
        assert client.post(f"{address}/cancel", headers=headers).status_code == 409

        assert client.post(f"{address}/resume", json={"workers": 1}, headers=headers).json()["state"] == "running"
        said = until(client, address, lambda said: said["state"] == "finished")
        assert (said["done"], said["total"], said["preliminary"]) == (2, 2, False)
        assert {figure["name"] for figure in said["figures"]} >= {"figure5", "figure11-nominal"}
        assert {claim["verdict"] for claim in said["claims"]}
        for figure in said["figures"]:
            answer = client.get(f"{address}/figures/{figure['id']}")
            assert answer.headers["content-type"] == "image/png"
            assert answer.content.startswith(b"\x89PNG")
        answer = client.get(f"{address}/report")
        assert answer.headers["content-security-policy"] == REPORT_POLICY
        assert "sandbox" in REPORT_POLICY.split(";")[0]
        assert answer.text.startswith("<!doctype html>")
        results = client.get(f"{address}/results").json()
        rows = [dict(zip(results["columns"], row, strict=True)) for row in results["rows"]]
        assert {row["controller"] for row in rows} == {"no_interim", "proposed"}
        table = list(csv.DictReader(client.get(f"{address}/csv").text.splitlines()))
        assert {row["id"] for row in table} == {row["id"] for row in rows}

        before = len(client.get("/api/logs").json())
        for _ in range(2):  # a second time it is already there
            log = client.post(f"{address}/logs/{results['logs'][0]}", headers=headers).json()["log"]
        assert client.get(f"/api/logs/{log}").json()["row"]["controller"] == rows[0]["controller"]
        assert len(client.get("/api/logs").json()) == before + 1


@pytest.mark.long
def test_one_that_was_cancelled_at_once_is_begun_again_in_the_same_second(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(campaigns.time, "strftime", lambda layout, when: "20261123-050000Z")
    kept = campaigns.Campaigns(tmp_path, tmp_path / "robot.sock")
    try:
        for began in range(1, 4):
            campaign = kept.start(str(plan), True, 1, NICENESS)
            assert len({view.id for view in kept.views()}) == began
            kept.cancel(campaign.id)
            deadline = time.monotonic() + PATIENCE_S
            while kept.view(campaign.id).state in ("running", "ending"):
                assert time.monotonic() < deadline
                time.sleep(0.01)
    finally:
        kept.close()


@pytest.mark.long
def test_a_campaign_ends_with_the_console_however_that_ends(plan, tmp_path):
    """A console that is killed lets go of the pipe: the campaign ends, and so does everything that it started."""
    program = (
        "import sys, time; from pathlib import Path; from console.campaigns.campaigns import Campaigns\n"
        f"Campaigns(Path({str(tmp_path)!r}), Path()).start({str(plan)!r}, False, 1, 10)\n"
        "print('begun', flush=True); time.sleep(1000)"
    )
    console = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert console.stdout is not None
    assert console.stdout.readline() == "begun\n"
    (child,) = psutil.Process(console.pid).children()
    (said,) = (tmp_path / "campaigns").glob("*.txt")
    deadline = time.monotonic() + PATIENCE_S
    while "references: " not in said.read_text():
        assert time.monotonic() < deadline
        time.sleep(0.1)
    started = child.children(recursive=True)
    console.send_signal(signal.SIGKILL)
    console.wait()
    console.stdout.close()
    _, alive = psutil.wait_procs([child, *started], timeout=PATIENCE_S)
    assert not alive, said.read_text()
    assert "Traceback" not in said.read_text()


@pytest.mark.long
def test_one_on_this_cell_takes_over_pauses_goes_on_and_gives_control_back(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    stack = Stack(tmp_path / "logs")
    left = []
    try:
        plan = {"name": "tiny", "controllers": ["proposed"], "objects": ["rice_box"], "displacements_mm": "20 0 -20"}
        stack.post("plans", **plan)
        with stack.beating():
            stack.post("take")
            stack.post("arm")
            campaign = stack.post("campaigns", name="tiny", on_cell=True, workers=1)
            address = f"/api/campaigns/{campaign['id']}"
            until(stack.client, address, lambda said: said["total"])
        assert campaign["on_cell"]
        until(stack.client, address, lambda said: said["stage"] == "trials" and said["done"] == 1)
        assert stack.client.get("/api/status").json()["holder"] == "campaign tiny"
        stack.post(f"campaigns/{campaign['id']}/pause")
        said = until(stack.client, address, lambda said: said["says"])
        assert said["paused"]
        assert said["says"].startswith("paused by operator 1: press Go on")
        stack.post(f"campaigns/{campaign['id']}/continue")
        said = until(stack.client, address, lambda said: said["state"] == "finished")
        assert (said["done"], said["paused"], said["says"]) == (3, False, "")
        results = stack.client.get(f"{address}/results").json()
        assert len(results["rows"]) == 3
        assert all(results["logs"])
        assert stack.client.get("/api/status").json()["holder"] is None
    finally:
        left = stack.end()
    assert left == []


def test_on_this_cell_only_who_has_armed_may_start_one_and_only_what_can_run_there(served):
    with served.signed_in() as (client, headers):
        answers = []
        for name in ("aim-aware-grab", "reference-spreading"):
            order = {"name": name, "quick": True, "on_cell": True}
            answers.append(client.post("/api/campaigns", json=order, headers=headers))
        assert [answer.status_code for answer in answers] == [409, 409]
        assert answers[0].json()["error"] == "on_cell: aim-aware-grab runs in the simulator alone"
        assert answers[1].json()["error"].startswith("take control and arm the arms first")
        listed = client.get("/api/campaigns").json()
        assert listed["campaigns"] == []
        assert {plan["name"] for plan in listed["plans"] if plan["on_cell"]} >= {"reference-spreading"}
        answer = client.post(f"/api/campaigns/{NO_CONTEXT}/continue", headers=headers)
        assert answer.status_code == 404


def test_it_is_no_way_to_disturb_who_has_the_robot(served):
    order = {"name": "reference-spreading", "quick": True}
    with served.signed_in() as (client, headers):
        arm(client, headers)
        answer = client.post("/api/campaigns", json=order, headers=headers)
        assert (answer.status_code, answer.json()["error"].split(":")[0]) == (409, "the arms are armed")
        robot = RobotClient(served.parts.client._path)
        robot.take("ben", over_from="operator 1")
        answer = client.post("/api/campaigns", json={**order, "nice": True}, headers=headers)
        assert (answer.status_code, answer.json()["error"].split(":")[0]) == (409, "ben has control")
        robot.close()
        assert client.post("/api/campaigns", json=order).status_code == 403
        wrong = ({"name": "../etc"}, 404, "name: there is no"), ({**order, "workers": 0}, 422, "workers")
        for bad, status, says in wrong:
            answer = client.post("/api/campaigns", json=bad, headers=headers)
            assert (answer.status_code, answer.json()["error"].startswith(says)) == (status, True)
        listed = client.get("/api/campaigns").json()
        assert listed["campaigns"] == []
        sizes = {plan["name"]: (plan["trials"], plan["quick_trials"]) for plan in listed["plans"]}
        assert sizes["reference-spreading"] == (1710, 84)
        assert sizes["aim-aware-grab"] == (1076, 63)
        assert sizes["impact-map-validation"][0] == 450


def test_ids_lead_nowhere_else_and_what_others_have_put_there_is_no_campaign(served):
    other = served.logs / "campaigns"
    other.mkdir()
    (other / "foreign.json").write_text('{"name": "x"}')
    (other / "failed.json").write_text('{"name": "reference-spreading", "quick": true, "began_s": 1.0}')
    (other / "failed.txt").write_text("rtstack: no room\n")
    with served.signed_in() as (client, headers):
        (failed,) = client.get("/api/campaigns").json()["campaigns"]
        assert (failed["state"], failed["message"]) == ("failed", "rtstack: no room")
        address = f"/api/campaigns/{failed['id']}"
        assert client.post(f"{address}/resume", json={}, headers=headers).status_code == 409
        for path in ("", "/report", "/results", "/csv", f"/figures/{NO_CONTEXT}"):
            for wrong in (f"/api/campaigns/{NO_CONTEXT}{path}", f"/api/campaigns/..%2F..%2Fetc{path}"):
                assert client.get(wrong).status_code in (404, 422), wrong
        for path in (f"/figures/{NO_CONTEXT}", "/report"):
            assert client.get(f"{address}{path}").status_code == 404
        assert client.post(f"{address}/logs/{NO_CONTEXT}", headers=headers).status_code == 404
        assert httpx.codes.is_success(client.get(f"{address}/results").status_code)


def test_a_log_that_a_table_names_outside_of_its_folder_is_not_given_away(tmp_path):
    (tmp_path / "secret").write_text("s")
    one = folder.CampaignFolder(tmp_path / "one")
    one.path.mkdir()
    origin = dict.fromkeys(store.PROVENANCE)
    with store.Store(one.path, {"log": str}) as results:
        for name, log in (("a", "../secret"), ("b", str(Path("/etc/hostname")))):
            results.add({"id": name, "log": log} | origin)
    assert [one.log(folder.hidden(trial)) for trial in "ab"] == [None, None]


def test_names_are_those_of_the_runner():
    assert (folder.DATABASE, folder.PROGRESS, folder.PAUSE) == (store.DATABASE, progress.PROGRESS, stack_operator.PAUSE)
    assert (folder.PAGE, folder.FIGURES, folder.NUMBERS) == (report.PAGE, report.FIGURES, report.NUMBERS)


def test_a_plan_of_the_users_own_is_kept_offered_and_run_by_its_name_as_on_the_command_line(
    served, tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    folder_of_plans = tmp_path / "rtstack" / "campaigns"
    order = {
        "name": "wide-shifts", "controllers": ["proposed", "no_interim"], "objects": ["rice_box", "parcel"],
        "displacements_mm": "-20:20:20", "demonstrations": 2, "repetitions": 3,
    }  # fmt: skip
    with served.signed_in() as (client, headers):

        def keep(**change):
            return client.post("/api/plans", json={**order, **change}, headers=headers)

        for change, status, says in (
            ({"name": "../etc"}, 422, "name"), ({"name": "reference-spreading"}, 409, "name: reference"),
            ({"objects": ["piano"]}, 409, "objects: the cell has no piano"), ({"controllers": ["best"]}, 422, "contr"),
            ({"displacements_mm": "1:x"}, 422, 'displacements_mm: "1:x" is no'), ({"repetitions": 0}, 422, "repet"),
        ):  # fmt: skip
            answer = keep(**change)
            assert (answer.status_code, answer.json()["error"].startswith(says)) == (status, True), answer.json()
        assert not list(folder_of_plans.glob("*"))
        made = keep().raise_for_status().json()
        assert made == {
            "name": "wide-shifts", "title": "wide shifts", "trials": 2 * 2 * 2 * 3 * 3, "quick_trials": 4, "own": True,
            "problem": None, "on_cell": True,
        }  # fmt: skip
        assert keep().status_code == 409  # never over another one
        (folder_of_plans / "wrong.toml").write_text('name = "wrong"\n')
        (folder_of_plans / "reference-spreading.toml").write_text('name = "mine"\n')  # hides no installed one
        listed = client.get("/api/campaigns").json()
        assert listed["folder"] == str(folder_of_plans)
        plans = {plan["name"]: plan for plan in listed["plans"]}
        assert plans["wide-shifts"] == made
        assert plans["reference-spreading"]["trials"] == 1710
        assert "wrong.toml" in plans["wrong"]["problem"]
        hidden = "reference-spreading.toml"
        assert plans[hidden]["problem"] == (
            f"reference-spreading is an installed plan: give the file {folder_of_plans / hidden} another name"
        )
        for name in ("wrong", hidden):
            assert client.post("/api/campaigns", json={"name": name}, headers=headers).status_code == 409
    assert plan_file("wide-shifts").path == folder_of_plans / "wide-shifts.toml"
    capsys.readouterr()
    assert plan_file("reference-spreading").path.parent != folder_of_plans
    assert "is an installed plan: give" in capsys.readouterr().err
