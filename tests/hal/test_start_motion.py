"""Both arms to where a trial begins, against the real server in lockstep."""

import contextlib
import socket
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hal.cell import Cell
from hal.clock_relation import ClockRelation
from hal.errors import CommandRejected
from hal.fci import FciPair
from hal.joint_path import JointPath, JointSpeed
from hal.state import RobotMode
from hal.tracker import ObjectPose, TrackerTimes
from hal.tracker_link import DATAGRAM, NoTracker, TrackerLink
from rtstack.cells.robot_clock import RobotClock
from rtstack.trials.errors import TrialError
from rtstack.trials.start_motion import start_motion

QUICK = JointSpeed(1.0, 5.0)


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


def where(pair: FciPair) -> np.ndarray:
    return np.stack([arm.read().q.copy() for arm in (pair.left, pair.right)])


def never() -> bool:
    return False


def test_both_arms_get_there_and_can_be_torque_controlled_from_there(pair: FciPair):
    goal = where(pair)
    goal[0, 0] += 0.2
    goal[1, 0] -= 0.1
    assert pair.move(goal, QUICK, never)
    assert where(pair) == pytest.approx(goal, abs=2e-3)
    assert pair.left.read().robot_mode == pair.right.read().robot_mode == RobotMode.IDLE
    pair.start()
    for _ in range(5):
        for arm in (pair.left, pair.right):
            assert arm.read().robot_mode == RobotMode.MOVE
        for arm in (pair.left, pair.right):
            arm.write(np.zeros(7))


def test_a_stop_ends_the_motion_on_its_way_without_a_reflex(pair: FciPair):
    begin = where(pair)
    goal = begin.copy()
    goal[:, 0] += 0.4
    left = iter(range(400))
    assert not pair.move(goal, QUICK, lambda: next(left, None) is None)
    gone = (where(pair) - begin)[:, 0]
    assert np.all((gone > 0.02) & (gone < 0.38))
    assert gone[0] == pytest.approx(gone[1], abs=5e-3)
    assert pair.left.reflex() == pair.right.reflex() == ()


def test_whether_a_way_is_needed_and_may_be_gone(pair: FciPair, cell):
    opened = Cell("fci", pair.left, pair.right, NoTracker(), pair, own_clocks=True)
    assert start_motion(opened, cell, "rice_box") is None  # they are at home
    assert start_motion(replace(opened, link=None), cell, "rice_box") is None

    away = where(pair)
    away[0, 0] -= 0.15
    assert pair.move(away, QUICK, never)
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


def test_the_first_point_of_a_recording_is_found_from_home(pair: FciPair, cell, demonstration):
    from rtstack.trials.specification import TrialSpecification
    from rtstack.trials.trial import prepare_trial

    prepared = prepare_trial(TrialSpecification(str(demonstration.path)), cell)
    opened = Cell("fci", pair.left, pair.right, NoTracker(), pair, own_clocks=True)
    assert start_motion(opened, cell, "rice_box", 0.0, prepared.reference.ante[:, 0]) is None
    away = where(pair)
    away[1, 0] += 0.1
    assert pair.move(away, QUICK, never)
    way = start_motion(opened, cell, "rice_box", 0.0, prepared.reference.ante[:, 0])
    assert way is not None
    assert way.path.goal == pytest.approx(np.array([cell.left.home, cell.right.home]), abs=2e-3)
    lost = prepared.reference.ante[:, 0].copy()
    lost["position"][0, 0] += 2.0
    with pytest.raises(TrialError, match="where the left arm of this cell cannot be"):
        start_motion(opened, cell, "rice_box", 0.0, lost)


def test_a_reflex_after_lost_answers_is_told_with_them(scripted):
    with scripted('[[fault]]\nkind = "states_lost"\narm = "left"\nat_s = 0.2\nduration_s = 0.015\n') as pair:
        goal = where(pair)
        goal[:, 0] += 0.2
        with pytest.raises(CommandRejected, match=r"up to 1[5-7] ms had passed between two of our answers") as refused:
            pair.move(goal, QUICK, never)
        assert "joint_motion_generator_acceleration_discontinuity" in refused.value.errors


def test_an_object_that_a_tracker_of_another_clock_sees_elsewhere_is_refused(pair: FciPair, cell):
    with contextlib.closing(SeenByTheHostsClock((0.5, 0.0, 0.3))) as tracker:
        clock = RobotClock(pair, tracker.robot_clock)
        opened = Cell("fci", pair.left, pair.right, tracker, SimpleNamespace(wait=clock.wait), own_clocks=True)
        with pytest.raises(TrialError, match="the object is not in its place"):
            start_motion(opened, cell, "rice_box")


postures = arrays(np.float64, (2, 7), elements=st.floats(-2.0, 2.0))


@given(postures, postures, st.floats(0.05, 1.0), st.floats(0.1, 5.0))
def test_no_joint_is_faster_than_the_limit_and_both_arms_arrive_together(start, goal, speed, acceleration):
    path = JointPath.between(start, goal, JointSpeed(speed, acceleration))
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
    path = JointPath.between(here, here, JointSpeed(0.4, 1.0))
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
