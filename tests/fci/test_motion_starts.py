"""A motion starts where the arm is measured to be, or where it is held: neither noise, nor friction, nor sag is a step.

Since libfranka 0.15 (system 5.7.2) the vendor's examples begin at `q` and `O_T_EE`.
"""

from collections.abc import Callable

import numpy as np
import pylibfranka as franka
import pytest

from sim_robot.fci.protocol import Command
from tests.support.fci.client import connect
from tests.support.fci.motions import CARTESIAN, JOINT, TICKS, run, there_and_back
from tests.support.fci.motions import DIRECTION as UP
from tests.support.fci.raw import RawClient, errors_of
from tests.support.fci.server import Served

SOFT = 50.0  # Nm/rad: friction, and what gravity compensation leaves, pull the arm away from where it is held
STEP = 2e-4  # rad, m: ten times the noise of two readings
STARTS = 2


def from_q(state: franka.RobotState, share: float) -> franka.JointPositions:
    return franka.JointPositions(list(np.array(state.q) + 0.1 * there_and_back(share) * UP))


def from_O_T_EE(state: franka.RobotState, share: float) -> franka.CartesianPose:
    pose = np.array(state.O_T_EE)
    pose[14] += 0.05 * there_and_back(share)
    return franka.CartesianPose(list(pose))


LAWS = [from_q, from_O_T_EE]


def start(robot: franka.Robot, law: Callable, controller: franka.ControllerMode) -> object:
    joints = law is from_q
    return (robot.start_joint_position_control if joints else robot.start_cartesian_pose_control)(controller)


@pytest.mark.parametrize("controller", [JOINT, CARTESIAN])
@pytest.mark.parametrize("law", LAWS)
def test_a_motion_that_begins_at_the_measured_state(
    lockstep: Served, law: Callable, controller: franka.ControllerMode
) -> None:
    robot = connect(lockstep.left)
    for _ in range(STARTS):  # each meets other noise, and what the last motion has left
        states = run(start(robot, law, controller), law)
        assert np.abs(np.array(states[-1].q) - states[0].q).max() < 3e-3
        assert np.abs(np.array(states[TICKS // 2].q) - states[0].q).max() > 0.03


@pytest.mark.parametrize("law", LAWS)
def test_an_arm_that_sags_starts_where_it_is(lockstep: Served, law: Callable) -> None:
    robot = connect(lockstep.left)
    robot.set_joint_impedance([SOFT] * 7)
    states = run(start(robot, from_q, JOINT), from_q)  # from here on the arm lies below its goal
    off = np.abs(np.array(states[-1].q) - states[-1].q_d).max()
    assert off > 10.0 * STEP
    run(start(robot, law, JOINT), law)


def test_an_elbow_that_begins_where_it_is_measured(lockstep: Served) -> None:
    with RawClient(lockstep.left) as raw:
        first = state = raw.begin(0, 2)
        for tick in range(500):
            elbow = np.array(first["elbow"], dtype=float) + (0.02 * there_and_back(tick / 500.0), 0.0)
            raw.command(state, O_T_EE_c=first["O_T_EE"], elbow_c=elbow, valid_elbow=1)
            state = raw.state()
            assert state["robot_mode"] == franka.RobotMode.Move.value
            assert abs(state["elbow_c"][0] - elbow[0]) < 1e-6


@pytest.mark.parametrize("desired", [False, True])
@pytest.mark.parametrize("generator", ["joint", "cartesian"])
def test_a_first_command_beside_the_arm_is_a_step(lockstep: Served, generator: str, desired: bool) -> None:
    """Beside where it is measured, and beside where it is held."""
    with RawClient(lockstep.left) as raw:
        state = raw.begin(0, 0 if generator == "joint" else 2)
        if generator == "joint":
            q = np.array(state["q_d" if desired else "q"], dtype=float)
            q[4] += STEP
            raw.command(state, q_c=q)
        else:
            pose = np.array(state["O_T_EE_c" if desired else "O_T_EE"], dtype=float)
            pose[14] += STEP
            raw.command(state, O_T_EE_c=pose)
        assert raw.answer()[0] == Command.MOVE
        state = raw.state()
        errors = errors_of(state, "reflex_reason")
        assert f"{generator}_motion_generator_velocity_discontinuity" in errors
        assert not any("start_pose_invalid" in name for name in errors)
