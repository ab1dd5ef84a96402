"""The robot process's main thread on the simulated cell: idle, orders, a reflex and its recovery."""

import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deploy import cells
from hal.errors import RecoveryRefused
from hal.robot_errors import error_bit
from hal.state import RobotMode
from rtstack.cli.cells import live_source
from rtstack.live.desk import Desk, Refused
from rtstack.live.protocol import DemonstrationRequest, JobState, RecoverRequest, TrialRequest
from rtstack.live.robot import Robot
from rtstack.log.reader import read_log
from rtstack.log.ring import Rings
from rtstack.loop.mailbox import Mailbox, remove_mailbox
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.clock import PacedLockstep

CELL = Path(cells.__file__).parent / "grab.toml"
PATIENCE_S = 120.0


def wait_for(condition):
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "did not happen"
        time.sleep(0.01)


class RunningRobot:
    """A robot's main thread, run in a thread of the test, and the simulated cells that it opened."""

    def __init__(self, logs: Path) -> None:
        remove_mailbox("rtstack-test-robot")
        self.mailbox = Mailbox.create("rtstack-test-robot")
        self.rings = Rings.create()
        self.opened: list[SimulatedCell] = []
        source = replace(live_source(CELL), open_cell=self._open)
        self.desk = Desk(source, self.mailbox)
        self.logs = logs
        self._thread = threading.Thread(target=Robot(source, self.desk, self.rings, self.mailbox, logs).run)
        self._thread.start()

    def _open(self, object_name, displacement_m, seed):
        self.opened.append(simulated_cell(object_name, displacement_m, seed, clock=PacedLockstep()))
        return self.opened[-1].as_cell("lockstep")

    def latest(self, side):
        """Return the newest state of an arm that was shown."""
        record = self.rings.reader(f"/{side}/arm").latest()
        return None if record is None else record[0]

    def close(self):
        """End the thread and let go of the memory."""
        self.desk.end()
        self._thread.join(PATIENCE_S)
        self.rings.close()
        self.mailbox.close()


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


def test_a_reflex_is_shown_with_its_reason_and_recovered(robot):
    wait_for(lambda: robot.latest("left") is not None)
    before = robot.latest("left")["q"]
    robot.opened[0].boxes[0].trip(error_bit("joint_reflex"))
    wait_for(lambda: robot.latest("left")["robot_mode"] == RobotMode.REFLEX)
    assert robot.latest("left")["current_errors"] == error_bit("joint_reflex")
    np.testing.assert_allclose(robot.latest("left")["q"], before, atol=1e-2)
    wait_for(lambda: robot.desk.status().last_error is not None)
    assert "joint_reflex" in robot.desk.status().last_error
    assert robot.latest("right")["robot_mode"] == RobotMode.IDLE
    robot.desk.recover(RecoverRequest()).result(PATIENCE_S)
    assert robot.desk.status().last_error is None
    wait_for(lambda: robot.latest("left")["robot_mode"] == RobotMode.IDLE)
    assert len(robot.opened) == 1


def test_a_recovery_that_the_robot_refuses_says_why(robot, monkeypatch):
    wait_for(lambda: robot.latest("left") is not None)

    def refuse(side):
        raise RecoveryRefused("the cause persists: joint 4 at its limit")

    monkeypatch.setattr(robot.opened[0], "recover", refuse)
    with pytest.raises(RecoveryRefused, match="joint 4"):
        robot.desk.recover(RecoverRequest()).result(PATIENCE_S)
    assert "joint 4" in robot.desk.status().last_error


def test_a_lost_arm_is_said_and_a_recovery_opens_the_cell_again(robot):
    wait_for(lambda: robot.latest("left") is not None)
    robot.opened[0].left.close()
    wait_for(lambda: robot.desk.status().last_error is not None)
    robot.desk.recover(RecoverRequest()).result(PATIENCE_S)
    assert robot.desk.status().last_error is None
    assert len(robot.opened) == 2


def test_a_demonstration_then_a_trial_in_a_fresh_cell_each(robot):
    robot.desk.take(DemonstrationRequest("parcel", 1, 5))
    with pytest.raises(Refused, match="running"):
        robot.desk.take(DemonstrationRequest("parcel", 1, 5))
    wait_for(lambda: not robot.desk.status().job.active)
    job = robot.desk.status().job
    assert (job.state, job.success, job.reason) == (JobState.DONE, True, None)
    recording = robot.logs / job.log
    robot.desk.take(TrialRequest(str(recording), object="parcel", displacement_mm=-15.0, seed=5))
    wait_for(lambda: not robot.desk.status().job.active)
    job = robot.desk.status().job
    assert job.state is JobState.DONE
    assert job.progress == 1.0
    log = read_log(robot.logs / job.log)
    assert log.metadata["result"]["displacement_mm"] == "-15.0"
    assert [attachment.data for attachment in log.attachments if attachment.name == "reference.mcap"] == [
        recording.read_bytes()
    ]
    assert len(robot.opened) == 3
    assert robot.desk.status().object == "parcel"


def test_a_stop_ends_a_job_in_a_controlled_way_with_the_reason(robot):
    robot.desk.take(DemonstrationRequest("rice_box", 0, 0))
    wait_for(lambda: robot.desk.status().job.progress > 0.2)
    robot.desk.stop()
    wait_for(lambda: not robot.desk.status().job.active)
    job = robot.desk.status().job
    assert job.state is JobState.STOPPED
    assert "operator" in job.reason
    assert 0.2 < job.progress < 1.0
    log = read_log(robot.logs / job.log)
    assert log.complete
    assert np.abs(log.topic("/left/arm")["dq"][-1]).max() < 0.05


def test_what_is_impossible_fails_with_one_line_and_leaves_a_working_cell(robot, tmp_path):
    (tmp_path / "junk.mcap").write_bytes(b"junk")
    for reference in (tmp_path / "junk.mcap", tmp_path / "none.mcap"):
        robot.desk.take(TrialRequest(str(reference)))
        wait_for(lambda: not robot.desk.status().job.active)
        job = robot.desk.status().job
        assert job.state is JobState.FAILED
        assert reference.name in job.reason
        assert "\n" not in job.reason
        assert job.log is None
    t_ns = robot.latest("left")["t_ns"]
    wait_for(lambda: robot.latest("left")["t_ns"] != t_ns)
