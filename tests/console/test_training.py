"""Training: each fault can be played, comes at a random moment, and what the operator does about it is timed."""

import random
import time
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from console.live.remedies import remedy_of
from console.training.trainer import EARLIEST_S, EXERCISES, LATEST_S, SURPRISE, Action, Trainer
from rtstack.live.idle import IdleView
from rtstack.live.protocol import JobState
from rtstack.references.acceptance import AcceptanceState, load_acceptance
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, SIDES, Level, Mode
from sim_robot.faults.file import faults_in, refuse_link_faults
from tests.support.console.client import arm, wait_for


@pytest.mark.parametrize("exercise", EXERCISES, ids=lambda exercise: exercise.name)
def test_every_exercise_is_a_script_that_the_simulated_cell_takes(exercise):
    (fault,) = faults_in(tomllib.loads(exercise.faults(2.5)), exercise.name)
    assert fault.delay_ms == 2500
    refuse_link_faults((fault,))  # the cell in the robot process has no link
    remedy = remedy_of(exercise.row or None)
    assert (remedy.name if remedy else "") == exercise.row


def test_a_surprise_comes_at_any_moment_and_is_any_fault(served):
    trainer = Trainer(served.parts.watch, random.Random(1))
    drawn = [trainer.choose(SURPRISE) for _ in range(200)]
    assert {exercise.name for exercise, _ in drawn} == {exercise.name for exercise in EXERCISES}
    moments = np.array([at_s for _, at_s in drawn])
    assert EARLIEST_S <= moments.min() < EARLIEST_S + 0.2
    assert LATEST_S - 0.2 < moments.max() <= LATEST_S


class Running:
    """An exercise whose demonstration runs, in the rings."""

    def __init__(self, served, client, headers, fault, seen_s=0.0):
        self.served, self.client = served, client
        arm(client, headers)
        answer = client.post("/api/training", json={"fault": fault}, headers=headers)
        assert answer.status_code == 202
        assert answer.json()["exercise"]["stage"] == "waiting"
        order, _ = served.job_manager.collect()
        self.at_s = tomllib.loads(order.faults)["fault"][0]["at_s"]
        served.job_manager.started("x.mcap")
        self.at(seen_s)
        wait_for(lambda: served.parts.watch.view.left.mode == "TELEOPERATION")

    def at(self, t_s):
        """Let the robot's time be t_s since its first motion."""
        sample, control = np.zeros(1, ARM_SAMPLE), np.zeros(1, CONTROL_SAMPLE)
        sample["O_T_EE"], sample["t_ns"], control["mode"] = np.eye(4), round(1e9 * (1.0 + t_s)), Mode.TELEOPERATION
        for side in SIDES:
            self.served.rings.pusher(f"/{side}/arm").push(sample)
            self.served.rings.pusher(f"/{side}/control").push(control)

    def say(self, text):
        IdleView(self.served.rings).tell(Level.INFO, text, "operator")

    def view(self):
        return self.client.get("/api/training").json()["exercise"]

    def happen(self):
        began_s = time.monotonic()
        wait_for(lambda: self.at(time.monotonic() - began_s) or self.view()["stage"] == "happened")
        assert time.monotonic() - began_s >= self.at_s

    def over(self):
        wait_for(lambda: self.view()["stage"] == "over")
        return self.view()


@pytest.mark.parametrize(
    ("fault", "said", "right"),
    [
        ("object_lost", "anna pressed STOP", True),
        pytest.param("object_lost", "anna asked for a recovery", False, marks=pytest.mark.long),
        ("joint_reflex", "anna asked for a recovery", True),
        pytest.param("tracker_lost", "anna pressed STOP", False, marks=pytest.mark.long),
    ],
)
def test_what_the_operator_did_is_timed_and_judged(served, fault, said, right):
    with served.signed_in() as (client, headers):
        exercise = Running(served, client, headers, fault)
        exercise.happen()
        exercise.say(said)
        view = exercise.over()
        assert (view["right"], view["did"]) == (right, said)
        assert 0.0 <= view["after_s"] < 60.0
        assert view["todo"]


def test_a_stop_before_anything_is_wrong_is_too_early_and_a_good_demonstration_is_left_alone(served):
    with served.signed_in() as (client, headers):
        early = Running(served, client, headers, "object_lost")
        early.say("anna pressed STOP")
        view = early.over()
        assert (view["right"], view["verdict"]) == (False, "too early: nothing was wrong yet")
        served.job_manager.finished(JobState.DONE, None, True, None)
        calm = Running(served, client, headers, "tracker_lost")
        calm.happen()
        served.job_manager.finished(JobState.DONE, None, True, None)
        view = calm.over()
        assert (view["right"], view["did"]) == (True, None)
        action = next(exercise.action for exercise in EXERCISES if exercise.name == "tracker_lost")
        assert action is Action.GO_ON


def test_the_log_of_an_exercise_is_no_example_to_be_decided_about(served):
    with served.signed_in() as (client, headers):
        exercise = Running(served, client, headers, "object_lost")
        wait_for(lambda: served.parts.watch.view.status.job.log == "x.mcap")
        exercise.say("anna pressed STOP")
        exercise.over()
    acceptance = load_acceptance(served.logs / "x.mcap")
    assert (acceptance.verdict, acceptance.note) == (AcceptanceState.REJECTED, "training")


def test_an_exercise_is_not_over_because_the_watch_still_shows_the_job_before(served):
    """The watch looks every 20 ms, as the trainer does: which one is first is chance."""
    with served.signed_in() as (client, headers):
        Running(served, client, headers, "object_lost")
        status = served.parts.watch.view.status
        following = replace(status.job, number=status.job.number + 1)
        trainer = Trainer(served.parts.watch)
        trainer.follow(EXERCISES[0], 1.0, replace(status, job=following), surprise=False)
        time.sleep(0.2)  # the trainer looks every 20 ms
        assert trainer.view.stage == "waiting"
        for _ in range(2):  # the job that it follows, and one after it
            assert trainer.view.stage == "waiting"
            served.job_manager.finished(JobState.DONE, None, True, None)
            Running(served, client, headers, "object_lost")
        wait_for(lambda: trainer.view.stage == "over")
        assert trainer.view.verdict == "the fault did not come"
        assert served.parts.trainer.view.stage == "waiting"  # that the exercise before is over says nothing about it


def test_a_job_whose_clock_begins_anew_is_timed_by_it(served):
    """The first states that are seen of a job may be the last ones of the job before."""
    with served.signed_in() as (client, headers):
        exercise = Running(served, client, headers, "object_lost", seen_s=3.0)
        wait_for(lambda: served.parts.watch.robot_time_s() == 4.0)
        time.sleep(0.2)  # the trainer looks every 20 ms
        exercise.happen()


def test_real_arms_are_never_given_a_fault(served):
    served.application.state.parts = replace(served.parts, cell=replace(served.parts.cell, simulated=False))
    with served.signed_in() as (client, headers):
        arm(client, headers)
        answer = client.post("/api/training", json={"fault": "joint_reflex"}, headers=headers)
        assert (answer.status_code, "these arms are real" in answer.json()["error"]) == (409, True)
        assert 'id="training"' not in client.get("/").text
    assert served.job_manager.status().job is None
