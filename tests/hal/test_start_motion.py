"""Both arms to where a trial begins, against the real server in lockstep."""

import contextlib
import re
import socket
import time
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hal.cell import Cell
from hal.clock_relation import ClockRelation
from hal.fci import FciPair
from hal.state import RobotMode
from hal.tracker import ObjectPose, TrackerTimes
from hal.tracker_link import DATAGRAM, NoTracker, TrackerLink
from rtstack.cells.robot_clock import RobotClock
from rtstack.model.cell_description import StartMotionLimits
from rtstack.trials.errors import TrialError
from rtstack.trials.record import RunLog
from rtstack.trials.run_context import RunContext
from rtstack.trials.sight import check_sight
from rtstack.trials.start_motion import JointPath, start_motion
from tests.support.runs import StopAfter
from tests.support.start import QUICK, go, where


class SeenByTheHostsClock(TrackerLink):
    """A tracker that stamps by the host's clock, and whose poses arrive all the time."""

    def __init__(self, position: tuple[float, float, float]) -> None:
        self.robot_clock = ClockRelation()
        super().__init__(times=TrackerTimes("host", largest_age_ms=100.0), robot_clock=self.robot_clock)
        self._record, self._sender = np.zeros(1, DATAGRAM), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._record["seen"], self._record["orientation_wxyz"] = 1, (1.0, 0.0, 0.0, 0.0)
        self._record["position"] = position

    def latest(self) -> ObjectPose:
        self._record["t_ns"] = time.monotonic_ns()
        self._sender.sendto(self._record.tobytes(), self.address)
        return super().latest()

    def close(self) -> None:
        self._sender.close()
        super().close()


class Seen:
    """A tracker that sees the object where it is told."""

    def __init__(self, position: tuple[float, float, float]) -> None:
        self.pose = ObjectPose.empty()
        self.pose.record["seen"] = 1
        self.pose.position[:] = position

    def latest(self) -> ObjectPose:
        return self.pose


@pytest.fixture
def arms(pair: FciPair) -> Cell:
    """The arms of that server, which waits for their answers."""
    return Cell("lockstep", pair.left, pair.right, NoTracker(), pair)


def test_both_arms_get_there_and_can_be_torque_controlled_from_there(arms: Cell, cell):
    goal = where(arms)
    goal[0, 1] -= 0.15
    goal[1, 3] += 0.1
    goal[:, 6] += 0.3
    assert go(arms, cell, goal) is None
    assert where(arms) == pytest.approx(goal, abs=2e-3)
    assert [arm.read().robot_mode for arm in arms.arms] == [RobotMode.IDLE] * 2
    arms.start()
    for _ in range(5):
        for arm in arms.arms:
            assert arm.read().robot_mode == RobotMode.MOVE
        for arm in arms.arms:
            arm.write(np.zeros(7))


def test_a_stop_ends_the_motion_on_its_way_without_a_reflex(arms: Cell, cell):
    begin = where(arms)
    goal = begin.copy()
    goal[:, 6] += 0.4
    said = go(arms, cell, goal, RunContext(stop=StopAfter(400)))
    assert said == "stop requested by the operator: on the way to the start pose"
    gone = (where(arms) - begin)[:, 6]
    assert np.all((gone > 0.02) & (gone < 0.38))
    assert gone[0] == pytest.approx(gone[1], abs=5e-3)
    assert arms.left.reflex() == arms.right.reflex() == ()


def test_whether_a_way_is_needed_and_may_be_gone(arms: Cell, cell):
    opened = arms
    assert start_motion(opened, cell, "rice_box") is None  # they are at home
    assert start_motion(replace(opened, link=None), cell, "rice_box") is None

    away = where(arms)
    away[0, 0] -= 0.15
    assert go(arms, cell, away) is None
    way = start_motion(opened, cell, "rice_box")
    assert way is not None
    assert way.path.goal[0] == pytest.approx(cell.left.home)
    assert "at most 0.15 rad" in way.summary

    strict = replace(cell, start_motion=replace(cell.start_motion, longest_rad=0.1))
    with pytest.raises(TrialError, match=r"joint 1 of the left arm is 0\.15 rad from .*longest_rad = 0\.1"):
        start_motion(opened, strict, "rice_box")
    with pytest.raises(TrialError, match=r"not in its place but x \+0, y \+200, z \+0 mm"):
        start_motion(replace(opened, tracker=Seen((0.0, 0.2, 0.3))), cell, "rice_box")
    with pytest.raises(TrialError, match="the left pad would come too near to the object"):
        start_motion(replace(opened, tracker=Seen((0.0, 0.2, 0.3))), cell, "rice_box", 0.2)
    high = replace(cell, table=replace(cell.table, top_z=0.207))
    with pytest.raises(TrialError, match="the left pad would come too near to the table"):
        start_motion(opened, high, "")


def test_the_first_point_of_a_recording_is_found_from_home(arms: Cell, cell, demonstration):
    from rtstack.trials.specification import TrialSpecification
    from rtstack.trials.trial import prepare_trial

    prepared = prepare_trial(TrialSpecification(str(demonstration.path)), cell)
    opened = arms
    assert start_motion(opened, cell, "rice_box", 0.0, prepared.reference.ante[:, 0]) is None
    away = where(arms)
    away[1, 0] += 0.1
    assert go(arms, cell, away) is None
    way = start_motion(opened, cell, "rice_box", 0.0, prepared.reference.ante[:, 0])
    assert way is not None
    assert way.path.goal == pytest.approx(np.array([cell.left.home, cell.right.home]), abs=2e-3)
    lost = prepared.reference.ante[:, 0].copy()
    lost["position"][0, 0] += 2.0
    with pytest.raises(TrialError, match="where the left arm of this cell cannot be"):
        start_motion(opened, cell, "rice_box", 0.0, lost)


def test_an_object_that_a_tracker_of_another_clock_sees_elsewhere_is_refused(pair: FciPair, cell):
    with contextlib.closing(SeenByTheHostsClock((0.5, 0.0, 0.3))) as tracker:
        clock = RobotClock(pair, tracker.robot_clock)
        opened = Cell("fci", pair.left, pair.right, tracker, SimpleNamespace(wait=clock.wait), own_clocks=True)
        with pytest.raises(TrialError, match="the object is not in its place"):
            start_motion(opened, cell, "rice_box")


def test_arms_are_not_moved_where_the_tracker_shows_nothing(arms: Cell, cell):
    arms = replace(arms, own_clocks=True, link=SimpleNamespace(wait=lambda: 0))
    with pytest.raises(TrialError, match=r"no fresh pose of rice_box: .*kind = \"none\" under \[tracker\]"):
        check_sight(arms, cell, "rice_box")
    check_sight(arms, replace(cell, tracker=replace(cell.tracker, kind="none")), "rice_box")
    check_sight(arms, cell, "")


def test_a_table_that_stands_higher_than_the_file_says_is_met_softly_and_recorded(arms: Cell, cell):
    """Their file has the table 40 mm lower, and a home into which the pads sink by 13 mm."""
    low = replace(cell, table=replace(cell.table, top_z=cell.table.top_z - 0.04))
    lower = [replace(arm, home=(arm.home[0], arm.home[1] + 0.06, *arm.home[2:])) for arm in cell.arms]
    low = replace(low, left=lower[0], right=lower[1], safety=cell.safety | {"ee_lower": [-0.2, -0.4, 0.1]})
    way = start_motion(arms, low, "")
    assert way is not None
    log = RunLog(Path("unused.mcap"))
    said = go(arms, low, way.path.goal, RunContext(log), way.limits)
    assert said is not None
    assert re.search(r"on the way to the start pose: joint 2 of the (left|right) arm stays 0\.0[23]\d rad away", said)
    assert arms.left.reflex() == arms.right.reflex() == ()
    assert log.evidence is not None
    samples = {each.name: each.data for each in log.evidence.attachments}
    with np.load(BytesIO(samples["start_motion.npz"])) as found:
        force = np.linalg.norm(found["arm"]["O_F_ext_hat_K"][..., :3], axis=-1)
    assert 5.0 < force.max() < 50.0  # the judge's bound of the approach


postures = arrays(np.float64, (2, 7), elements=st.floats(-2.0, 2.0))


@given(postures, postures, st.floats(0.05, 1.0), st.floats(0.1, 5.0))
def test_no_joint_is_faster_than_the_limit_and_both_arms_arrive_together(start, goal, speed, acceleration):
    path = JointPath.between(start, goal, StartMotionLimits(speed, acceleration))
    assert np.array_equal(path.at(0.0), start) or path.duration_s == 0.0
    assert path.at(path.duration_s) == pytest.approx(goal, abs=1e-12)
    assert path.at(path.duration_s + 1.0) == pytest.approx(goal, abs=1e-12)
    if path.duration_s < 1e-3:
        return
    step_s = path.duration_s / 400
    q = np.array([path.at(k * step_s) for k in range(401)])
    dq = np.diff(q, axis=0) / step_s
    ddq = np.diff(dq, axis=0) / step_s
    assert np.abs(dq).max() <= speed * 1.001
    assert np.abs(ddq).max() <= acceleration * 1.01
    # and it is the quickest such way: one of the limits is met
    assert np.abs(dq).max() > 0.98 * speed or np.abs(ddq).max() > 0.98 * acceleration


def test_nowhere_to_go_takes_no_time():
    here = np.full((2, 7), 0.3)
    path = JointPath.between(here, here, StartMotionLimits(0.4, 1.0))
    assert path.duration_s == 0.0
    assert np.array_equal(path.at(0.0), here)


def test_arms_that_sag_near_the_table_may_rise_from_it_and_not_sink(cell):
    """A payload that the robot was not told of lets them sag by some mm at the end of a motion."""
    from rtstack.trials import start_motion as module

    arms = module.arm_controllers(cell, module.cell_parameters(cell))
    homes = cell.home
    low = homes.copy()
    low[0, 1] += 0.018  # the left pad, some 7 mm lower

    def looked(begin, end):
        module._look_along(JointPath.between(begin, end, QUICK), arms, cell, None)

    looked(low, homes)
    with pytest.raises(TrialError, match="the left pad would come too near to the table"):
        looked(homes, low)
    lower = low.copy()
    lower[0, 1] += 0.01
    with pytest.raises(TrialError, match="the left pad would come too near to the table"):
        looked(low, lower)
    sunk = homes.copy()
    sunk[0, 1] += 0.06  # lower than the table: it stands beside it, and its straight way up may lead into it
    unboxed = replace(cell, safety={})
    with pytest.raises(TrialError, match="the left pad would come too near to the table"):
        module._look_along(JointPath.between(sunk, homes, QUICK), arms, unboxed, None)
