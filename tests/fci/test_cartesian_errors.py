"""What a Cartesian motion, or a target of an asynchronous one, can do wrong, each by its name and nothing beside it."""

import struct
from collections.abc import Callable

import numpy as np
import pytest

from hal.robots import FR3
from hal.state import RobotMode
from sim_robot.fci.protocol import Command, Generator
from sim_robot.scene import load_scene
from tests.support.fci.client import connect, go_home
from tests.support.fci.raw import ANYWHERE, RawClient, errors_of
from tests.support.fci.server import Served

POSE, TWIST = Generator.CARTESIAN_POSITION, Generator.CARTESIAN_VELOCITY
TICKS = 20_000
NEAR_LIMIT = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3.008 - load_scene().left.home[6]])
Law = Callable[[int, np.void, np.void], dict]


def elbow(shift: Callable[[int], float], sign: Callable[[int], float] = lambda tick: 1.0) -> Law:
    """Stay where the motion begins, with an elbow that shifts, rad, and flips."""

    def law(tick: int, first: np.void, _: np.void) -> dict:
        at = np.array(first["elbow_c"], dtype=float) * (1.0, sign(tick)) + (shift(tick), 0.0)
        return {"O_T_EE_c": first["O_T_EE_c"], "elbow_c": at, "valid_elbow": 1}

    return law


def turning(speed: Callable[[int, np.void], float]) -> Law:
    """Turn about the flange's axis, which is joint 7's, at so many rad/s."""

    def law(tick: int, first: np.void, state: np.void) -> dict:
        axis = np.array(first["O_T_EE_c"], dtype=float)[8:11]
        return {"O_dP_EE_c": np.concatenate([np.zeros(3), speed(tick, state) * axis])}

    return law


def with_acceleration(step: float) -> Callable[[int, np.void], float]:
    """An acceleration that grows by `step` rad/s^2 each ms, for three ms."""
    speeds = np.cumsum([step, 2.0 * step, 3.0 * step]) * 1e-3
    return lambda tick, _: float(speeds[min(tick, 2)])


def creeping(_: int, state: np.void) -> float:
    """As fast as joint 7 may be so near to its limit, and slower than it is judged beyond that."""
    room = max(FR3.limits.q_upper[6] - float(state["q_d"][6]), 0.0)
    allowed = np.sqrt(2.0 * FR3.limits.deceleration[6] * room) - FR3.limits.velocity_offset[6]
    return max(8e-4, min(0.004, 0.5 * allowed))


def skewed(tick: int, first: np.void, _: np.void) -> dict:
    pose = np.array(first["O_T_EE_c"], dtype=float)
    pose[0] += 1e-3 * (tick > 5)
    return {"O_T_EE_c": pose}


def jolted(tick: int, first: np.void, _: np.void) -> dict:
    return {"O_dP_EE_c": np.array([0.0, 0.0, 0.1 * (tick > 5), 0.0, 0.0, 0.0])}


@pytest.mark.parametrize(
    ("near_limit", "generator", "law", "names"),
    [
        (False, POSE, elbow(lambda tick: 2e-3 * (tick > 5)), {"cartesian_motion_generator_elbow_limit_violation"}),
        (
            False,
            POSE,
            elbow(lambda tick: 0.0, lambda tick: 1.0 if tick < 5 else -1.0),
            {"cartesian_motion_generator_elbow_sign_inconsistent"},
        ),
        (
            False,
            POSE,
            elbow(lambda tick: 0.1),
            {"cartesian_motion_generator_start_elbow_invalid", "cartesian_motion_generator_elbow_limit_violation"},
        ),
        (False, POSE, skewed, {"cartesian_position_motion_generator_invalid_frame"}),
        (
            False,
            TWIST,
            jolted,
            {
                "cartesian_motion_generator_velocity_discontinuity",
                "cartesian_motion_generator_acceleration_discontinuity",
            },
        ),
        (True, TWIST, turning(creeping), {"cartesian_motion_generator_joint_position_limits_violation"}),
        (
            True,
            TWIST,
            turning(lambda tick, _: min(5e-4 * tick, 0.05)),
            {"cartesian_motion_generator_joint_velocity_limits_violation"},
        ),
        (False, TWIST, turning(with_acceleration(9.0)), {"cartesian_motion_generator_joint_velocity_discontinuity"}),
        (
            False,
            TWIST,
            turning(with_acceleration(14.0)),
            {"cartesian_motion_generator_joint_acceleration_discontinuity"},
        ),
    ],
)
def test_a_cartesian_motion(
    lockstep: Served, near_limit: bool, generator: Generator, law: Law, names: set[str]
) -> None:
    if near_limit:
        go_home(connect(lockstep.left), NEAR_LIMIT)
    with RawClient(lockstep.left) as raw:
        first = state = raw.begin(0, generator)
        for tick in range(TICKS):
            raw.command(state, **law(tick, first, state))
            state = raw.state()
            if state["robot_mode"] != RobotMode.MOVE:
                break
    assert reasons(state) == names


def test_a_target_beyond_a_joint(lockstep: Served) -> None:
    """An asynchronous motion: the robot plans the way."""
    with RawClient(lockstep.left) as raw:
        raw.connect()
        raw.send(Command.MOVE, struct.pack("<II3d3dB7d", 0, 0, *ANYWHERE, *ANYWHERE, 1, *(0.5,) * 7))
        assert raw.answer()[2][0] == 1
        state = raw.moving_state()
        raw.command(state, q_c=np.array(state["q_d"], dtype=float) + (4.0, 0, 0, 0, 0, 0, 0))
        while state["robot_mode"] == RobotMode.MOVE:
            state = raw.state()
    assert reasons(state) == {"joint_via_motion_generator_planning_joint_limit_violation"}


def reasons(state: np.void) -> set[str]:
    """The names of what ended the motion."""
    assert state["robot_mode"] == RobotMode.REFLEX
    return errors_of(state, "reflex_reason")
