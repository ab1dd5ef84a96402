"""The motion generators with both internal controllers, through pylibfranka."""

import numpy as np
import pylibfranka as franka
import pytest

from tests.support.fci.client import connect, go_home
from tests.support.fci.motions import (
    CARTESIAN,
    DIRECTION,
    JOINT,
    TICKS,
    assert_stopped_and_recover,
    run,
    speed,
    there_and_back,
)
from tests.support.fci.server import Served


def turned(state: franka.RobotState, share: float) -> franka.JointPositions:
    return franka.JointPositions(list(np.array(state.q_d) + 0.1 * there_and_back(share) * DIRECTION))


def lifted(state: franka.RobotState, share: float) -> franka.CartesianPose:
    pose = np.array(state.O_T_EE_c)
    pose[14] += 0.05 * there_and_back(share)
    return franka.CartesianPose(list(pose))


def assert_followed(states: list[franka.RobotState]) -> None:
    """The arm goes where it is told, as closely as an impedance with friction does, and comes back."""
    middle, last = states[TICKS // 2], states[-1]
    assert np.abs(np.array(middle.O_T_EE) - states[0].O_T_EE).max() > 0.01
    for state in (middle, last):
        assert np.abs(np.array(state.O_T_EE) - state.O_T_EE_d).max() < 3e-3
    assert np.abs(np.array(last.O_T_EE_d) - states[0].O_T_EE_d).max() < 1e-3
    assert max(max(np.abs(state.dq_d)) for state in states) > 0.03


@pytest.mark.parametrize("controller", [JOINT, CARTESIAN])
def test_joint_positions(lockstep: Served, controller: franka.ControllerMode) -> None:
    assert_followed(run(connect(lockstep.left).start_joint_position_control(controller), turned))


@pytest.mark.parametrize("controller", [JOINT, CARTESIAN])
def test_joint_velocities(lockstep: Served, controller: franka.ControllerMode) -> None:
    control = connect(lockstep.left).start_joint_velocity_control(controller)
    states = run(control, lambda state, share: franka.JointVelocities(list(0.05 * speed(share) * DIRECTION)))
    assert_followed(states)


@pytest.mark.parametrize("controller", [JOINT, CARTESIAN])
def test_poses(lockstep: Served, controller: franka.ControllerMode) -> None:
    states = run(connect(lockstep.left).start_cartesian_pose_control(controller), lifted)
    assert_followed(states)
    assert states[TICKS // 2].O_T_EE_d[14] - states[0].O_T_EE_d[14] == pytest.approx(0.05, abs=1e-4)


@pytest.mark.parametrize("controller", [JOINT, CARTESIAN])
def test_twists(lockstep: Served, controller: franka.ControllerMode) -> None:
    control = connect(lockstep.left).start_cartesian_velocity_control(controller)
    twist = np.array([0.0, 0.0, 0.025, 0.05, 0.0, 0.0])
    assert_followed(run(control, lambda state, share: franka.CartesianVelocities(list(speed(share) * twist))))


@pytest.mark.parametrize(
    ("size", "from_share", "name"),
    [
        (1e-5, 0.1, "cartesian_motion_generator_acceleration_discontinuity"),
        (5e-3, 0.1, "cartesian_motion_generator_velocity_limits_violation"),
        (0.1, 0.0, "cartesian_position_motion_generator_start_pose_invalid"),
    ],
)
def test_a_pose_that_jumps(lockstep: Served, size: float, from_share: float, name: str) -> None:
    """Joint positions and velocities that jump: test_faults."""

    def jump(state: franka.RobotState, share: float) -> franka.CartesianPose:
        pose = np.array(state.O_T_EE_c)
        pose[14] += size * (share >= from_share)
        return franka.CartesianPose(list(pose))

    robot = connect(lockstep.left)
    with pytest.raises(franka.ControlException, match=name):
        run(robot.start_cartesian_pose_control(JOINT), jump)
    robot.automatic_error_recovery()


def test_a_link_that_comes_near_the_table(lockstep: Served) -> None:
    """A self-collision: the hand's link goes to the table before the pad does."""
    robot = connect(lockstep.left)
    goal = np.array([-0.28, -0.03, -0.19, -2.88, -1.35, 0.76, 1.09])

    def fold(state: franka.RobotState, share: float) -> franka.JointPositions:
        start = np.array(state.q_d)
        return franka.JointPositions(list(start + 0.5 * there_and_back(share / 2.0) * (goal - start)))

    with pytest.raises(franka.ControlException, match="self_collision_avoidance_violation"):
        run(robot.start_joint_position_control(JOINT), fold)
    assert_stopped_and_recover(robot, {"self_collision_avoidance_violation"})
    go_home(robot)
