"""The motion generators with both internal controllers, through pylibfranka and through franky-control."""

import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pylibfranka as franka
import pytest

from tests.support.fci.client import connect, go_home, program_path
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
    robot = connect(lockstep.left)
    go_home(robot)
    assert_followed(run(robot.start_joint_position_control(controller), turned))


@pytest.mark.parametrize("controller", [JOINT, CARTESIAN])
def test_joint_velocities(lockstep: Served, controller: franka.ControllerMode) -> None:
    robot = connect(lockstep.left)
    go_home(robot)
    control = robot.start_joint_velocity_control(controller)
    states = run(control, lambda state, share: franka.JointVelocities(list(0.05 * speed(share) * DIRECTION)))
    assert_followed(states)


@pytest.mark.parametrize("controller", [JOINT, CARTESIAN])
def test_poses(lockstep: Served, controller: franka.ControllerMode) -> None:
    robot = connect(lockstep.left)
    go_home(robot)
    states = run(robot.start_cartesian_pose_control(controller), lifted)
    assert_followed(states)
    assert states[TICKS // 2].O_T_EE_d[14] - states[0].O_T_EE_d[14] == pytest.approx(0.05, abs=1e-4)


@pytest.mark.parametrize("controller", [JOINT, CARTESIAN])
def test_twists(lockstep: Served, controller: franka.ControllerMode) -> None:
    robot = connect(lockstep.left)
    go_home(robot)
    control = robot.start_cartesian_velocity_control(controller)
    twist = np.array([0.0, 0.0, 0.025, 0.05, 0.0, 0.0])
    assert_followed(run(control, lambda state, share: franka.CartesianVelocities(list(speed(share) * twist))))


def jumping(law: Callable, size: float) -> Callable:
    def jump(state: franka.RobotState, share: float) -> object:
        command = law(state, 0.0)
        values = command.q if isinstance(command, franka.JointPositions) else command.O_T_EE
        values = np.array(values)
        values[-2 if len(values) == 16 else 3] += size * (share > 0.1 if size < 0.01 else 1)
        return type(command)(list(values))

    return jump


@pytest.mark.parametrize(
    ("law", "size", "name"),
    [
        (turned, 1e-5, "joint_motion_generator_acceleration_discontinuity"),
        (turned, 5e-3, "joint_motion_generator_velocity_discontinuity"),
        (turned, 0.1, "joint_position_motion_generator_start_pose_invalid"),
        (lifted, 1e-5, "cartesian_motion_generator_acceleration_discontinuity"),
        (lifted, 5e-3, "cartesian_motion_generator_velocity_limits_violation"),
        (lifted, 0.1, "cartesian_position_motion_generator_start_pose_invalid"),
    ],
)
def test_a_motion_that_jumps(lockstep: Served, law: Callable, size: float, name: str) -> None:
    robot = connect(lockstep.left)
    go_home(robot)
    start = robot.start_joint_position_control if law is turned else robot.start_cartesian_pose_control
    with pytest.raises(franka.ControlException, match=name):
        run(start(JOINT), jumping(law, size))
    robot.automatic_error_recovery()


def test_a_link_that_comes_near_the_table(lockstep: Served) -> None:
    """A self-collision: the hand's link goes to the table before the pad does."""
    robot = connect(lockstep.left)
    go_home(robot)
    goal = np.array([-0.28, -0.03, -0.19, -2.88, -1.35, 0.76, 1.09])

    def fold(state: franka.RobotState, share: float) -> franka.JointPositions:
        start = np.array(state.q_d)
        return franka.JointPositions(list(start + 0.5 * there_and_back(share / 2.0) * (goal - start)))

    with pytest.raises(franka.ControlException, match="self_collision_avoidance_violation"):
        run(robot.start_joint_position_control(JOINT), fold)
    assert_stopped_and_recover(robot, {"self_collision_avoidance_violation"})
    go_home(robot)


def test_an_unmodified_franky_program(lockstep: Served) -> None:
    """In its own process: franky and pylibfranka cannot be imported together."""
    program = program_path("franky")
    finished = subprocess.run(
        [sys.executable, str(program), lockstep.left], capture_output=True, text=True, timeout=60, check=False
    )
    assert finished.returncode == 0, finished.stderr
    joint_error, way, return_error = (float(word) for word in finished.stdout.split())
    assert joint_error < 3e-3
    assert way == pytest.approx(0.05, abs=3e-3)
    assert return_error < 3e-3
