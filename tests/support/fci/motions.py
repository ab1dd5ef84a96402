"""Motions over pylibfranka that several tests run, and how an arm that was stopped is recovered."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pylibfranka as franka
import pytest

from hal.robot_errors import ROBOT_ERRORS
from tests.support.fci.client import DAMPING, STIFFNESS, hold, torque_control

JOINT, CARTESIAN = franka.ControllerMode.JointImpedance, franka.ControllerMode.CartesianImpedance
DIRECTION = np.array([0.5, -1.0, 0.5, 0.0, 1.0, 1.0, 1.0])  # up, away from the table
TICKS = 2000


def there_and_back(t: float) -> float:
    return (1.0 - np.cos(2.0 * np.pi * t)) / 2.0


def speed(t: float) -> float:
    return np.pi * np.sin(2.0 * np.pi * t)


def run(control, law: Callable[[franka.RobotState, float], Any]) -> list[franka.RobotState]:
    """Run `law(first state, share of the motion)` for two seconds and return the states."""
    states = []
    for tick in range(TICKS + 1):
        state, _ = control.readOnce()
        states.append(state)
        command = law(states[0], tick / TICKS)
        command.motion_finished = tick == TICKS
        control.writeOnce(command)
    return states


def held(state: np.void, q_hold: np.ndarray) -> np.ndarray:
    """A joint impedance of a raw client, (7,), Nm."""
    return STIFFNESS * (q_hold - state["q"]) - DAMPING * state["dq"]


def names(errors: franka.Errors) -> set[str]:
    """Names of the errors of a client's state."""
    return {name for name in ROBOT_ERRORS if getattr(errors, name)}


def assert_stopped_and_recover(robot: franka.Robot, expected: set[str]) -> None:
    """In reflex with these errors; a Move is refused, a StopMove clears nothing; then the recovery, then control."""
    state = robot.read_once()
    assert state.robot_mode == franka.RobotMode.Reflex
    assert names(state.current_errors) == names(state.last_motion_errors) == expected
    with pytest.raises(franka.CommandException, match="Reflex"):
        robot.start_torque_control()
    with pytest.raises(franka.CommandException, match="aborted by reflex"):
        robot.stop()
    assert robot.read_once().robot_mode == franka.RobotMode.Reflex
    robot.automatic_error_recovery()
    state = robot.read_once()
    assert state.robot_mode == franka.RobotMode.Idle
    assert not names(state.current_errors)
    q_hold = np.array(state.q)
    states = torque_control(robot, 50, lambda tick, state: hold(state, q_hold))
    assert states[-1].robot_mode == franka.RobotMode.Move
