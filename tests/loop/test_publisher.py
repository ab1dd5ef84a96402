"""What a run publishes and when, its low-pass and where its next torque starts from; a robot that is killed in it."""

import math
import os
import re
import signal

import numpy as np
import psutil
import pytest

from hal.tracker import ObjectPose
from rtstack.cells import default_cell_file, open_cell
from rtstack.control.records import WORKSPACE
from rtstack.log.reader import read_log
from rtstack.log.ring import Rings
from rtstack.loop.command_echo import CommandEcho
from rtstack.loop.publisher import Publisher
from rtstack.loop.session import low_pass, low_pass_share
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, Level
from rtstack.trials.assembly import arm_controllers, default_parameters, safety_judges
from rtstack.trials.demonstration import run_demonstration
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import DemonstrationSpecification

MS = 1_000_000
ORIGIN_NS = 5_000 * MS


class Tracker:
    """Shows one pose after the other: stamp, and height of the object, m."""

    def __init__(self) -> None:
        self.pose = ObjectPose.empty()

    def latest(self) -> ObjectPose:
        return self.pose

    def see(self, t_ns: int, height_m: float) -> None:
        self.pose.record["t_ns"], self.pose.record["position"][0, 2], self.pose.record["seen"] = t_ns, height_m, 1

    def close(self) -> None:
        pass


@pytest.mark.parametrize("first_ns", [ORIGIN_NS - 7 * MS, ORIGIN_NS, ORIGIN_NS + 3 * MS])
def test_the_newest_pose_before_the_first_answer_is_the_one_at_zero(first_ns: int) -> None:
    """The robot shows its first state, and poses, until it is answered: which of them is read is the host's doing."""
    tracker = Tracker()
    left, right = ((np.zeros(1, ARM_SAMPLE), np.zeros(1, CONTROL_SAMPLE)) for _ in range(2))
    with Rings.create() as rings:
        publisher = Publisher([rings], None)
        reader = rings.reader("/object/pose")
        tracker.see(first_ns, 0.1)
        publisher.look(tracker, ORIGIN_NS, 0)
        publisher.tick((left, right))
        # the second state says when the first one was answered: it was shown for 4 ms
        for now_ms, seen_ms, height_m in ((1, 2, 0.1), (2, 4, 0.1), (3, 7, 0.2), (4, 7, 0.2), (8, 12, 0.3)):
            tracker.see(ORIGIN_NS + seen_ms * MS, height_m)
            publisher.look(tracker, ORIGIN_NS + 4 * MS, now_ms * MS)
            publisher.tick((left, right))
        poses = reader.drain()
    assert poses["t_ns"].tolist() == [0, 3 * MS, 8 * MS]
    assert poses["position"][:, 2].tolist() == [0.1, 0.2, 0.3]


def test_who_sees_the_arms_of_a_tick_sees_the_objects_pose_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A camera drew the object where it had not been seen yet, when the loop was pushed off its CPU between the two."""
    tracker, there = Tracker(), []
    left, right = ((np.zeros(1, ARM_SAMPLE), np.zeros(1, CONTROL_SAMPLE)) for _ in range(2))
    with Rings.create() as rings:
        publisher = Publisher([rings], None)
        reader = rings.reader("/object/pose")
        monkeypatch.setattr("rtstack.loop.publisher.push_all", lambda rows: there.append(len(reader.drain())))
        tracker.see(ORIGIN_NS, 0.1)
        publisher.look(tracker, ORIGIN_NS, 0)
        publisher.tick((left, right))
    assert there == [1]


SENT, OLD = np.full(7, 3.0), np.full(7, 1.5)


@pytest.fixture
def running(cell):
    """An arm whose last torque, SENT, has left, with its judge and its echo; the robot has had a torque of ours."""
    arm, judge = arm_controllers(cell, default_parameters())[0], safety_judges(cell)[0]
    echo = CommandEcho(judge, arm)
    arm.sample["tau_J_d"], judge.memory["tau_applied"] = SENT, SENT
    echo.agree(begun=True)
    assert echo.seen
    judge.memory["tau_J"] = arm.sample["tau_J"] = np.arange(7.0)
    arm.sample["tau_J_d"], arm.workspace["tau_previous"] = OLD, SENT
    return arm, judge, echo


def test_an_answer_that_was_dropped_is_no_start_for_the_next_torque(running):
    arm, judge, echo = running
    arm.sample["tau_J"] += 1e-3
    echo.agree(begun=True)
    assert echo.lost == 1
    np.testing.assert_array_equal(arm.workspace["tau_previous"][0], OLD)
    np.testing.assert_array_equal(judge.memory["tau_applied"][0], OLD)


def test_a_state_that_repeats_the_last_one_tells_nothing_of_the_torque(running):
    """The robot took the last torque, and its state stands still: from an older one the next would jump."""
    arm, judge, echo = running
    echo.agree(begun=True)
    assert echo.lost == 0
    np.testing.assert_array_equal(arm.workspace["tau_previous"][0], SENT)
    np.testing.assert_array_equal(judge.memory["tau_applied"][0], SENT)


def test_a_simulator_that_is_killed_ends_the_session(cell, tmp_path):
    path = tmp_path / "killed.mcap"
    specification = DemonstrationSpecification()
    before = set(psutil.Process().children())
    opened = open_cell("lockstep", "rice_box", 0.0, 0, cell)
    (pid,) = [each.pid for each in psutil.Process().children() if each not in before]

    class Kill:
        ticks = 0

        def trip(self) -> None:
            self.ticks += 1
            if self.ticks == 100:
                os.kill(pid, signal.SIGKILL)

    try:
        log = open_log(path, specification, cell, "lockstep", default_cell_file())
        result = run_demonstration(specification, cell, opened, RunContext(log, watchdogs=(Kill(),)))
    finally:
        opened.close()
    assert re.match("the robot left torque control: the (left|right) arm at 127", str(result.failure_reason))
    found = read_log(path)
    assert found.metadata["fault"]["reaction_ticks"] == ""  # nobody is left to take a torque
    assert found.metadata["fault"]["detail"] in str(result.failure_reason)
    errors = [event for event in found.events if event.level is Level.ERROR]
    assert len(errors) == 1
    assert abs(found.topic("/left/arm")["t_ns"][-1] - errors[0].t_ns) <= 1_000_000


def test_it_is_off_by_default_and_a_low_cutoff_is_slow():
    assert low_pass_share(0.0) == 1.0
    assert low_pass_share(100.0) == pytest.approx(1e-3 / (1e-3 + 1.0 / (2.0 * math.pi * 100.0)))
    assert low_pass_share(10.0) < low_pass_share(100.0) < 1.0


def test_a_step_is_approached_and_never_passed():
    sample, work = np.zeros(1, ARM_SAMPLE), np.zeros(1, WORKSPACE)
    share = low_pass_share(50.0)
    last = 0.0
    for k in range(1, 40):
        sample["tau_desired"][0] = 0.8
        low_pass(sample, work, share)
        tau = float(sample["tau_desired"][0, 3])
        assert last < tau < 0.8
        assert tau == pytest.approx(0.8 * (1.0 - (1.0 - share) ** k))
        work["tau_previous"][0] = sample["tau_desired"][0]
        last = tau


def test_what_is_no_number_is_left_to_the_judge():
    sample, work = np.zeros(1, ARM_SAMPLE), np.zeros(1, WORKSPACE)
    sample["tau_desired"][0, 2] = np.nan
    low_pass(sample, work, 0.3)
    assert np.isnan(sample["tau_desired"][0, 2])
