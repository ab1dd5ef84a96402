"""The robot process's main thread on the simulated cell: idle, orders, what ends them, faults and recovery."""

import itertools
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer

import rtstack.live.jobs
from hal.errors import RecoveryRefused
from hal.robot_errors import error_bit
from hal.state import RobotMode
from rtstack.cli.recovery import recover_arms
from rtstack.live.audit import AuditTrail
from rtstack.live.client import RUN_PREFIX, SOCKET_NAME
from rtstack.live.job_manager import JobManager
from rtstack.live.protocol import JobState, RunRequest
from rtstack.live.robot import Service
from rtstack.live.source import live_source
from rtstack.log.reader import read_log
from rtstack.log_folder.catalogue import entry_of
from rtstack.log_folder.log_rows import log_row
from rtstack.log_folder.search import Outcome, search
from rtstack.loop.end import End
from rtstack.loop.mailbox import TARGET, Mailbox, Release
from rtstack.safety.arming import Phase, Refused
from rtstack.samples import Mode
from rtstack.trials.errors import TrialError
from rtstack.trials.followed import followed_file
from rtstack.trials.specification import (
    DemonstrationSpecification,
    GuideSpecification,
    MoveSpecification,
    TeleoperationSpecification,
    TrialSpecification,
)
from rtstack.trials.tightening import limits_of_arms
from tests.support.console.client import wait_for
from tests.support.console.running_robot import CELL, RunningRobot

pytestmark = pytest.mark.alone
PATIENCE_S = 120.0
DEMONSTRATION = RunRequest(DemonstrationSpecification(), "anna")


@pytest.fixture
def robot(tmp_path):
    running = RunningRobot(tmp_path)
    yield running
    running.close()


def test_an_idle_cell_is_shown_and_never_commanded(robot):
    wait_for(lambda: robot.latest("right") is not None and robot.latest("right")["t_ns"] > 300_000_000)
    for side, box in zip(("left", "right"), robot.opened[0].boxes, strict=True):
        sample = robot.latest(side)
        assert sample["robot_mode"] == RobotMode.IDLE
        assert not sample["tau_desired"].any()
        assert not sample["tau_applied"].any()
        assert box.mode == RobotMode.IDLE  # a write would have started torque control
        assert np.abs(sample["dq"]).max() < 0.1
    assert robot.rings.reader("/object/pose").latest()["seen"][0]


class Still:
    """A link, for arms that are asked for their states and do not move."""

    def close(self):
        pass


@pytest.mark.parametrize(
    ("kg", "says"), [(0.3, "the detector counts from it"), (1.5, "a trial would be refused: the left arm feels")]
)
def test_what_the_arms_feel_at_rest_is_said_when_they_are_armed(tmp_path, kg, says):
    class Loaded(RunningRobot):
        def _open(self, *what):
            cell = super()._open(*what)
            self.opened[-1].plant.joints["payload_error"] = kg
            return replace(cell, link=Still())

    robot, told = Loaded(tmp_path), []
    events = robot.rings.reader("/events")
    try:
        wait_for(lambda: robot.latest("left") is not None and robot.latest("left")["t_ns"] > 300_000_000)
        robot.authority.take("anna")
        assert not any(says in event["text"].decode() for event in events.drain())
        robot.authority.arm("anna")
        wait_for(lambda: told.extend(e["text"].decode() for e in events.drain()) or any(says in text for text in told))
    finally:
        robot.close()


def test_a_motion_moves_the_arms_of_the_cell_that_is_open_after_a_fault_too(robot):
    wait_for(lambda: robot.latest("left") is not None)
    robot.opened[0].boxes[0].trip(error_bit("joint_reflex"))
    wait_for(lambda: robot.authority.view().phase is Phase.FAULT)
    with pytest.raises(Refused, match="recover first"):
        robot.order(RunRequest(MoveSpecification("open"), "anna"))
    robot.job_manager.recover("anna").result(PATIENCE_S)
    robot.order(RunRequest(MoveSpecification("open"), "anna"))
    job = robot.finished()
    assert (job.kind, job.title, job.state, job.success) == ("move", "open", JobState.DONE, True)
    assert "-move-open" in job.log
    robot.order(RunRequest(MoveSpecification("put_down"), "anna"))
    job = robot.finished()
    assert (job.state, job.log) == (JobState.FAILED, None)
    assert job.reason == "nothing is held between the pads: there is nothing to put down"
    assert len(robot.opened) == 1  # what the arms hold is not let go


def test_a_reflex_is_shown_with_its_reason_and_recovered(robot):
    wait_for(lambda: robot.latest("left") is not None)
    before = robot.latest("left")["q"]
    robot.opened[0].boxes[0].trip(error_bit("joint_reflex"))
    wait_for(lambda: robot.latest("left")["robot_mode"] == RobotMode.REFLEX)
    assert robot.latest("left")["current_errors"] == error_bit("joint_reflex")
    np.testing.assert_allclose(robot.latest("left")["q"], before, atol=1e-2)
    wait_for(lambda: robot.authority.view().phase is Phase.FAULT)
    assert "joint_reflex" in robot.authority.view().reason
    assert robot.latest("right")["robot_mode"] == RobotMode.IDLE
    with pytest.raises(Refused, match=r"there is a fault: .*joint_reflex.*; recover first"):
        robot.order(DEMONSTRATION)
    robot.job_manager.recover("anna").result(PATIENCE_S)
    assert (robot.authority.view().phase, robot.authority.view().reason) == (Phase.DISARMED, None)
    wait_for(lambda: robot.latest("left")["robot_mode"] == RobotMode.IDLE)
    assert len(robot.opened) == 1
    with pytest.raises(Refused, match="arm them first"):
        robot.job_manager.order(DEMONSTRATION)
    with pytest.raises(Refused, match="nothing to recover from"):
        robot.job_manager.recover("anna")


def test_a_recovery_that_the_robot_refuses_says_why_and_the_fault_stays(robot, monkeypatch):
    wait_for(lambda: robot.latest("left") is not None)
    robot.opened[0].boxes[0].trip(error_bit("joint_reflex"))
    wait_for(lambda: robot.authority.view().phase is Phase.FAULT)

    def refuse(side):
        raise RecoveryRefused("the cause persists: joint 4 at its limit")

    monkeypatch.setattr(robot.opened[0], "recover", refuse)
    with pytest.raises(RecoveryRefused, match="joint 4"):
        robot.job_manager.recover("anna").result(PATIENCE_S)
    assert robot.authority.view().phase is Phase.FAULT
    assert "joint 4" in robot.authority.view().reason
    # nobody can move simulated arms out of it by hand: others are set up, and the recovery is asked for once more
    robot.job_manager.recover("anna").result(PATIENCE_S)
    assert robot.authority.view().phase is Phase.DISARMED
    assert len(robot.opened) == 2


def test_a_refusal_that_is_seen_after_the_recovery_was_asked_for_does_not_undo_it(tmp_path):
    mailbox = Mailbox.create("rtstack-test-refusal")
    audit = AuditTrail(tmp_path / "audit.jsonl")
    try:
        job_manager = JobManager(live_source(CELL), mailbox, audit, tmp_path)
        job_manager.refused("in reflex")
        assert job_manager.authority.view().phase is Phase.FAULT
        job_manager.recover("anna")
        job_manager.refused("in reflex")  # as it was when it was looked at
        job_manager.authority.recovered()
        assert job_manager.authority.view().phase is Phase.DISARMED
    finally:
        audit.close()
        mailbox.close()


def test_a_lost_arm_is_said_and_a_recovery_opens_the_cell_again(robot):
    wait_for(lambda: robot.latest("left") is not None)
    robot.opened[0].left.close()
    wait_for(lambda: robot.authority.view().phase is Phase.FAULT)
    robot.job_manager.recover("anna").result(PATIENCE_S)
    assert robot.authority.view().phase is Phase.DISARMED
    assert len(robot.opened) == 2


@pytest.mark.long  # tests/browser/test_operate does both by the page
def test_a_demonstration_then_a_trial_in_a_fresh_cell_each(robot):
    robot.order(replace(DEMONSTRATION, specification=DemonstrationSpecification("parcel", variation=1, seed=5)))
    with pytest.raises(Refused, match="running"):
        robot.job_manager.order(DEMONSTRATION)
    job = robot.finished()
    assert (job.state, job.success, job.reason) == (JobState.DONE, True, None)
    assert robot.authority.view().phase is Phase.ARMED
    recording = robot.logs / job.log
    robot.job_manager.order(
        RunRequest(TrialSpecification(str(recording), object="parcel", displacement_mm=-15.0, seed=5), "anna")
    )
    job = robot.finished()
    assert job.state is JobState.DONE
    assert job.progress == 1.0
    assert robot.authority.view().phase is Phase.ARMED  # a grab that does not succeed is no fault
    log = read_log(robot.logs / job.log)
    assert log.metadata["result"]["displacement_mm"] == "-15.0"
    listed = [(entry := entry_of(log.path), log_row(entry, None))]
    assert [len(search(listed, f"operator={name}", Outcome.ANY)) for name in ("anna", "ben")] == [1, 0]
    assert followed_file(log, "") == (log.metadata["reference"]["sha256"], recording.read_bytes())
    assert len(robot.opened) == 3
    assert robot.job_manager.status().object == "parcel"


def test_a_stop_ends_a_job_in_a_controlled_way_and_disarms(robot):
    robot.order(DEMONSTRATION)
    wait_for(lambda: robot.job_manager.status().job.progress > 0.2)
    robot.authority.stop("ben")
    job = robot.finished()
    assert job.state is JobState.STOPPED
    assert "operator" in job.reason
    assert 0.2 < job.progress < 1.0
    log = read_log(robot.logs / job.log)
    assert log.complete
    assert np.abs(log.topic("/left/arm")["dq"][-1]).max() < 0.05
    assert ("operator", "ben pressed STOP") in robot.events(job)
    assert (robot.authority.view().phase, robot.authority.view().reason) == (Phase.DISARMED, None)
    with pytest.raises(Refused, match="arm them first"):
        robot.job_manager.order(DEMONSTRATION)


def _goes(robot, who):
    setattr(robot, who, False)


@pytest.mark.parametrize(
    ("event", "end", "fault"),
    [
        (lambda robot: _goes(robot, "operator_is_there"), End.OPERATOR_GONE, True),
        (lambda robot: _goes(robot, "console_is_there"), End.CONSOLE_GONE, True),
        (lambda robot: robot.opened[-1].boxes[1].trip(error_bit("joint_reflex")), End.HARDWARE, True),
        (lambda robot: robot.job_manager.end(End.PARENT_GONE, "the supervisor has died"), End.PARENT_GONE, True),
        (lambda robot: robot.authority.release("anna"), End.STOP_REQUESTED, False),
        (lambda robot: robot.authority.disarm("ben"), End.STOP_REQUESTED, False),
    ],
    ids=["operator gone", "console gone", "reflex", "supervisor gone", "released", "disarmed"],
)
def test_what_ends_a_motion_is_said_in_its_log_and_only_a_recovery_leads_out_of_a_fault(robot, event, end, fault):
    robot.order(DEMONSTRATION)
    wait_for(lambda: robot.job_manager.status().job.progress > 0.05)
    event(robot)
    job = robot.finished()
    assert job.reason.startswith(end)
    assert not job.success
    log = read_log(robot.logs / job.log)
    assert log.complete
    assert log.metadata["result"]["failure_reason"] == job.reason
    said = [text for _, text in robot.events(job)]
    assert end is End.HARDWARE or any(text.startswith(end) for text in said)  # the arm's own words
    assert np.abs(log.topic("/left/arm")["dq"][-1]).max() < 0.05
    view = robot.authority.view()
    assert view.phase is (Phase.FAULT if fault else Phase.DISARMED)
    assert view.reason == (job.reason if fault else None)
    robot.console_is_there = robot.operator_is_there = True
    if robot.job_manager.ending:
        return
    with pytest.raises(Refused):
        robot.job_manager.order(DEMONSTRATION)
    if fault:
        robot.job_manager.recover("ben").result(PATIENCE_S)
        assert robot.authority.view().phase is Phase.DISARMED


def test_a_recovery_is_refused_while_the_judge_would_stop_the_arms_where_they_are(tmp_path):
    robot = RunningRobot(tmp_path, safety={"ee_upper": [9.0, 9.0, 0.0]})  # below the table: nowhere
    try:
        robot.order(DEMONSTRATION)
        assert robot.finished().reason.startswith(End.SAFETY)
        for _ in range(2):
            with pytest.raises(RecoveryRefused, match="the end effector has left its box: the cause persists"):
                robot.job_manager.recover("anna").result(PATIENCE_S)
            assert robot.authority.view().phase is Phase.FAULT
    finally:
        robot.close()


def _hold(robot, **changes):
    """Say of the clutch of the newest job what a page says."""
    target = np.zeros(1, TARGET)
    target["job"], target["clutch_ns"] = robot.job_manager.job_number, time.monotonic_ns()
    for name, value in changes.items():
        target[name] = value
    robot.mailbox.write_target(target)


def test_a_hand_leads_the_arms_out_of_the_cause_of_a_fault_while_the_clutch_is_held(tmp_path):
    description = live_source(CELL).description
    lower = [float(q) for q in limits_of_arms(description)[0].q_lower]
    lower[0] = description.left.home[0] + 0.05  # where the left arm stands is beyond it
    robot = RunningRobot(tmp_path, safety={**description.safety, "q_lower": lower})
    try:
        robot.order(DEMONSTRATION)
        robot.finished()
        assert robot.authority.view().phase is Phase.FAULT
        with pytest.raises(RecoveryRefused, match="Guide by hand"):
            robot.job_manager.recover("anna").result(PATIENCE_S)
        robot.authority.take("anna")  # a machine under load may have lost it
        with pytest.raises(Refused, match="anna has control"):
            robot.job_manager.order(RunRequest(GuideSpecification(), "ben"))

        robot.job_manager.order(RunRequest(GuideSpecification(), "anna"))  # and the clutch is not held
        job = robot.finished()
        assert (job.state, job.reason) == (
            JobState.FAILED,
            "the clutch was not held (C on the page, a gamepad, a phone): nothing has moved",
        )

        robot.job_manager.order(RunRequest(GuideSpecification(), "anna"))
        cell = robot.opened[-1]
        looks, deadline = 0, time.monotonic() + PATIENCE_S
        while cell.states[0]["q"][0] < lower[0] + 0.03:
            assert time.monotonic() < deadline
            assert robot.job_manager.status().job.active
            _hold(robot)
            looks += bool(robot.latest("left")["tau_desired"].any())
            push = min(12.0, 0.4 * looks)  # Nm, within 0.6 s: as a hand begins
            cell.plant.motors[0]["tau_applied"][0] = push
            time.sleep(0.02)
        cell.plant.motors[0]["tau_applied"][0] = 0.0
        assert robot.authority.view().phase is Phase.FAULT  # which it does not end
        _hold(robot, clutch_ns=0, release=Release.RELEASED)
        job = robot.finished()
        assert (job.kind, job.state, job.success, job.log) == ("guide", JobState.DONE, True, None)
        robot.job_manager.recover("anna").result(PATIENCE_S)
        assert robot.authority.view().phase is Phase.DISARMED
    finally:
        robot.close()


def test_real_arms_move_while_a_clutch_is_held_whatever_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(rtstack.live.jobs, "_HOLD_S", 0.5)
    robot = RunningRobot(tmp_path, simulated=False)
    try:
        robot.order(DEMONSTRATION)
        job = robot.finished()
        assert (job.state, job.log) == (JobState.FAILED, None)
        assert job.reason.startswith("the clutch was not held")
        monkeypatch.setattr(rtstack.live.jobs, "_HOLD_S", PATIENCE_S)
        robot.order(DEMONSTRATION)

        def moves() -> bool:
            _hold(robot)
            assert robot.job_manager.status().job.active
            state = robot.latest("left")
            return state is not None and abs(state["dq"]).max() > 0.05

        wait_for(moves)
        _hold(robot, clutch_ns=0, release=Release.RELEASED)
        job = robot.finished()
        assert (job.success, End.in_reason(job.reason)) == (False, End.RELEASED)
        assert read_log(robot.logs / job.log).complete
        robot.order(RunRequest(MoveSpecification("open"), "anna", watched=True))  # by a campaign
        assert robot.finished().success
    finally:
        robot.close()


@pytest.mark.parametrize(
    ("ends", "state", "phase", "reason"),
    [
        (lambda robot: robot.mailbox.request_stop(), JobState.STOPPED, Phase.DISARMED, None),
        (lambda robot: None, JobState.DONE, Phase.FAULT, End.CLUTCH_QUIET),  # the page says nothing any more
        (lambda robot: robot.authority.release("anna"), JobState.STOPPED, Phase.DISARMED, None),
    ],
    ids=["STOP", "quiet", "released"],
)
def test_what_a_hand_leads_is_stopped_as_any_motion(robot, ends, state, phase, reason):
    robot.authority.take("anna")
    robot.authority.arm("anna")
    robot.job_manager.order(RunRequest(GuideSpecification(), "anna"))
    shown = robot.rings.reader("/left/control")
    led = itertools.count()

    def follows_a_hand():
        _hold(robot)
        record = shown.latest()
        return record is not None and record["mode"][0] == Mode.TELEOPERATION and next(led) > 20

    wait_for(follows_a_hand)
    ends(robot)
    job = robot.finished()
    assert job.state is state
    assert robot.authority.view().phase is phase
    assert (robot.authority.view().reason or "").startswith(reason or "")


def test_what_is_impossible_fails_with_one_line_and_leaves_a_working_cell(robot, tmp_path):
    (tmp_path / "junk.mcap").write_bytes(b"junk")
    for reference in (tmp_path / "junk.mcap", tmp_path / "none.mcap"):
        robot.order(RunRequest(TrialSpecification(str(reference)), "anna"))
        job = robot.finished()
        assert robot.authority.view().phase is Phase.ARMED
        assert job.state is JobState.FAILED
        assert reference.name in job.reason
        assert "\n" not in job.reason
        assert job.log is None
    t_ns = robot.latest("left")["t_ns"]
    wait_for(lambda: robot.latest("left")["t_ns"] != t_ns)


def test_a_running_stack_recovers_at_a_terminal(robot, monkeypatch, capsys):
    with tempfile.TemporaryDirectory(dir="/tmp") as name:  # short: a socket's path has 107 letters at most
        monkeypatch.setattr(tempfile, "tempdir", name)
        with pytest.raises(TrialError, match="no stack is running: start one"):
            recover_arms()
        folder = Path(name) / f"{RUN_PREFIX}run"
        (Path(name) / f"{RUN_PREFIX}dead").mkdir()
        (Path(name) / f"{RUN_PREFIX}dead" / SOCKET_NAME).touch()
        folder.mkdir()
        service = Service(robot.job_manager, folder / SOCKET_NAME)
        try:
            wait_for(lambda: robot.latest("left") is not None)
            with pytest.raises(typer.Exit) as refused:
                recover_arms()
            assert refused.value.exit_code == 1
            said = capsys.readouterr()
            assert (said.out, said.err) == (
                "grab: disarmed\n",
                "rtstack: nothing to recover from: the arms are disarmed\n",
            )
            robot.opened[0].boxes[1].trip(error_bit("joint_reflex"))
            wait_for(lambda: robot.authority.view().phase is Phase.FAULT)
            recover_arms()
            first, last = capsys.readouterr().out.splitlines()
            assert first.startswith("grab: fault: right arm in reflex: joint_reflex")
            assert last == "grab: disarmed: take control and arm to go on"
            assert robot.authority.view().phase is Phase.DISARMED
            with pytest.raises(TrialError, match="not both"):
                recover_arms("fci:a,b", folder / SOCKET_NAME)
        finally:
            service.close()


def test_what_is_practised_leaves_no_log_and_what_is_recorded_leaves_one(robot):
    for recorded in (False, True):
        robot.order(RunRequest(TeleoperationSpecification("", recorded=recorded, stop_on_release=False), "anna"))
        wait_for(lambda: robot.job_manager.status().job.state is JobState.RUNNING)
        written = robot.logs / robot.job_manager.status().job.log
        wait_for(written.exists)  # it is logged meanwhile: evidence of a fault
        robot.mailbox.request_stop()
        job = robot.finished()
        assert (job.state, job.log) == (JobState.STOPPED, written.name if recorded else None)
        assert written.exists() is recorded
