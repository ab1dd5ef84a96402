"""Every fault ends with the vendor's name for it, stays until the recovery, and can be recovered."""

import time

import numpy as np
import pylibfranka as franka
import pytest

from hal.state import RobotMode
from sim_robot.fci.protocol import Command, MoveStatus
from tests.support.fci.client import connect, go_home, hold, torque_control
from tests.support.fci.motions import assert_stopped_and_recover
from tests.support.fci.raw import RawClient
from tests.support.fci.server import Served

NAN, INF = float("nan"), float("inf")


def fail(robot: franka.Robot, ticks: int, law) -> None:
    with pytest.raises(franka.ControlException):
        torque_control(robot, ticks, law)


def one(joint: int, value: float) -> np.ndarray:
    tau = np.zeros(7)
    tau[joint - 1] = value
    return tau


@pytest.mark.parametrize("value", [NAN, INF, -INF])
def test_a_torque_that_is_no_number(lockstep: Served, value: float) -> None:
    with RawClient(lockstep.left) as raw:
        raw.connect()
        assert raw.move() == MoveStatus.MOTION_STARTED
        for tick in range(10):
            tau = one(3, value) if tick == 9 else np.zeros(7)
            raw.command(raw.state(), tau_J_d=tau)
        command, _, body = raw.answer()
        assert (command, body[0]) == (Command.MOVE, MoveStatus.REFLEX_ABORTED)
    # a new client finds the arm as it was left
    assert_stopped_and_recover(connect(lockstep.left), {"controller_torque_discontinuity"})


@pytest.mark.parametrize(
    "law", [lambda tick: one(1, 200.0), lambda tick: one(2, 40.0 if tick % 2 else -40.0), lambda tick: one(7, 1.1)]
)
def test_a_torque_that_jumps(lockstep: Served, law) -> None:
    robot = connect(lockstep.left)
    fail(robot, 100, lambda tick, state: law(tick) if tick >= 20 else np.zeros(7))
    assert_stopped_and_recover(robot, {"controller_torque_discontinuity"})


@pytest.mark.realtime
@pytest.mark.parametrize("stall_s", [0.05, 0.3])  # of this clock; test_fault_delay counts by the robot's
def test_a_client_that_stalls(realtime: Served, stall_s: float) -> None:
    robot = connect(realtime.left)
    q_hold = np.array(robot.read_once().q)

    def law(tick: int, state: franka.RobotState) -> np.ndarray:
        if tick == 100:
            time.sleep(stall_s)  # the fault itself
        return hold(state, q_hold)

    fail(robot, 400, law)
    assert_stopped_and_recover(robot, {"communication_constraints_violation"})


def test_a_joint_that_is_too_fast(lockstep: Served) -> None:
    robot = connect(lockstep.left)
    go_home(robot)
    fail(robot, 2000, lambda tick, state: one(1, -min(0.2 * tick, 30.0)))
    assert_stopped_and_recover(robot, {"joint_velocity_violation"})
    go_home(robot)


def test_a_recovery_is_answered_once_the_arm_stands(realtime: Served) -> None:
    """A client that goes on at once, with a damping of its own, would otherwise begin in the middle of the braking."""
    with RawClient(realtime.left) as raw:
        raw.connect()
        assert raw.move() == MoveStatus.MOTION_STARTED
        while (state := raw.state())["robot_mode"] != RobotMode.REFLEX:
            raw.command(state, tau_J_d=-np.eye(7)[0] * min(abs(float(state["tau_J_d"][0])) + 0.9, 30.0))
        assert np.abs(state["dq"]).max() > 1.0
        raw.answer()
        raw.send(Command.AUTOMATIC_ERROR_RECOVERY)
        assert raw.answer()[2] == b"\0"
        raw.state()  # what has come meanwhile
        assert np.abs(raw.next_state()["dq"]).max() < 0.03


def test_a_joint_that_is_pushed_into_its_limit(lockstep: Served) -> None:
    robot = connect(lockstep.left)
    go_home(robot)
    q_hold = np.array(robot.read_once().q)

    def law(tick: int, state: franka.RobotState) -> np.ndarray:
        q_hold[6] = min(q_hold[6] + 1e-3, 3.2)
        return hold(state, q_hold)

    fail(robot, 4000, law)
    assert_stopped_and_recover(robot, {"joint_velocity_violation"})
    go_home(robot)


def test_a_joint_that_creeps_over_its_limit(lockstep: Served) -> None:
    robot = connect(lockstep.left)
    go_home(robot, np.array([0, 0, 0, 0, 0, 0, 3.0 - 1.090987]))
    q_hold = np.array(robot.read_once().q)

    def law(tick: int, state: franka.RobotState) -> np.ndarray:
        q_hold[6] += 1e-5
        return hold(state, q_hold)

    fail(robot, 9000, law)
    assert_stopped_and_recover(robot, {"joint_position_limits_violation"})
    go_home(robot)


def test_a_contact_above_the_threshold(lockstep: Served) -> None:
    robot = connect(lockstep.left)
    go_home(robot)
    low, high = [5.0] * 7, [100.0] * 7
    robot.set_collision_behavior(low, high, [4.0] * 6, [15.0] * 6)
    q_hold = np.array(robot.read_once().q)
    seen = []

    def law(tick: int, state: franka.RobotState) -> np.ndarray:
        q_hold[1] += 2e-4  # the pad goes down to the table
        seen.append((max(state.cartesian_contact), max(state.cartesian_collision)))
        return hold(state, q_hold)

    fail(robot, 3000, law)
    state = robot.read_once()
    assert max(state.cartesian_collision) == 1.0  # latched
    assert max(seen) == (1.0, 0.0)  # first the contact, which does not stop
    assert_stopped_and_recover(robot, {"cartesian_reflex"})
    assert max(robot.read_once().cartesian_collision) == 0.0
    robot.set_collision_behavior([20.0] * 7, [100.0] * 7, [20.0] * 6, [250.0] * 6)
    go_home(robot)


def test_a_reflex_outlives_its_client(lockstep: Served) -> None:
    fail(connect(lockstep.right), 50, lambda tick, state: one(1, 50.0) if tick == 20 else np.zeros(7))
    assert_stopped_and_recover(connect(lockstep.right), {"controller_torque_discontinuity"})
