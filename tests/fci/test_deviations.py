"""The deviations that Move names: the robot stops where its pose is further off on the path, or at the goal."""

import numpy as np
import pytest

from hal.state import RobotMode
from sim_robot.fci.protocol import Command, MoveStatus
from tests.support.fci.client import smooth
from tests.support.fci.raw import ANYWHERE, Deviation, RawClient, errors_of
from tests.support.fci.server import Served

SOFT = np.full(7, 200.0)  # Nm/rad: the arm lags behind by its friction
WAY = np.array([0.1, -0.2, 0.1, 0.0, 0.2, 0.2, 0.2])  # up, away from the table
TICKS = 600
TOLERANCES = (1e-3, 3e-3, 1e-3)  # m, rad, rad: less than the arm lags
TINY = (1e-6, 1e-6, 1e-6)
POSITIONS = (0, 0)  # joint impedance, joint positions


def one_of(deviation: Deviation, part: int) -> Deviation:
    """Only this part of a deviation matters."""
    return tuple(deviation[part] if i == part else ANYWHERE[i] for i in range(3))  # pyright: ignore[reportReturnType]


def deviations(state: np.void) -> np.ndarray:
    """Of the measured pose from the desired one, (3,): m, rad, rad."""
    T, T_d = (state[name].astype(float).reshape(4, 4).T for name in ("O_T_EE", "O_T_EE_d"))
    chord = np.linalg.norm(T[:3, :3] - T_d[:3, :3])  # = 2 sqrt(2) sin(angle / 2)
    turned = 2.0 * np.arcsin(chord / np.sqrt(8.0))
    return np.array([np.linalg.norm(T[:3, 3] - T_d[:3, 3]), turned, abs(state["elbow"][0] - state["elbow_d"][0])])


def run(raw: RawClient, path: Deviation = ANYWHERE, goal: Deviation = ANYWHERE) -> list[np.void]:
    """Go the way, softly, and say so at its end; the states of the motion, and the one that shows how it ended."""
    raw.connect()
    raw.send(Command.SET_JOINT_IMPEDANCE, SOFT.tobytes())
    raw.answer()
    assert raw.move(*POSITIONS, path=path, goal=goal) == MoveStatus.MOTION_STARTED
    state = raw.moving_state()
    states, start = [state], state["q_d"].astype(float)
    for tick in range(TICKS + 1):
        way = smooth(tick / TICKS) * WAY
        raw.command(states[-1], q_c=start + way, motion_generation_finished=tick == TICKS)
        states.append(raw.state())
        if states[-1]["robot_mode"] != RobotMode.MOVE:
            break
    return states


@pytest.mark.parametrize("part", range(3), ids=["translation", "rotation", "elbow"])
def test_a_path_deviation_stops_the_arm_at_once(lockstep: Served, part: int) -> None:
    tolerance = one_of(TOLERANCES, part)
    with RawClient(lockstep.left) as raw:
        states = run(raw, path=tolerance)
        assert raw.answer()[2] == bytes((MoveStatus.REFLEX_ABORTED,))
    off = [deviations(state)[part] / tolerance[part] for state in states[:-1]]  # the last one desires to be where it is
    assert 0.9 < off[-1] <= max(off) <= 1.0  # it lags more each ms, and the first ms too much has stopped it
    assert len(states) < TICKS
    assert errors_of(states[-1]) == {"max_path_pose_deviation_violation"}


@pytest.mark.parametrize("part", range(3), ids=["translation", "rotation", "elbow"])
def test_a_goal_deviation_counts_at_the_end_only(lockstep: Served, part: int) -> None:
    with RawClient(lockstep.left) as raw:
        states = run(raw, goal=one_of(TINY, part))
        assert raw.answer()[2] == bytes((MoveStatus.REFLEX_ABORTED,))
    assert len(states) == TICKS + 2
    assert errors_of(states[-1]) == {"max_goal_pose_deviation_violation"}


def test_who_is_within_both_deviations_arrives(lockstep: Served) -> None:
    most = (0.03, 0.1, 0.05)
    with RawClient(lockstep.left) as raw:
        states = run(raw, path=most, goal=most)
        assert raw.answer()[2] == bytes((MoveStatus.SUCCESS,))
    assert np.all(np.max([deviations(state) for state in states], axis=0) > TOLERANCES)  # which would have stopped it
    assert not errors_of(states[-1])


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -1.0])
def test_a_deviation_that_is_none_is_an_invalid_argument(lockstep: Served, bad: float) -> None:
    with RawClient(lockstep.left) as raw:
        raw.connect()
        assert raw.move(*POSITIONS, path=(bad, 1.0, 1.0)) == MoveStatus.INVALID_ARGUMENT
        assert raw.move(*POSITIONS, goal=(1.0, bad, 1.0)) == MoveStatus.INVALID_ARGUMENT
