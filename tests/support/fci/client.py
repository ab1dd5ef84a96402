"""Small client programs over pylibfranka that several tests run."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pylibfranka as franka

from sim_robot.scene import load_scene

CLIENTS = Path(__file__).parents[2] / "programs" / "clients"
STIFFNESS, DAMPING = np.array([200.0] * 4 + [50.0] * 3), np.array([20.0] * 4 + [3.0] * 3)
MEASURED = ("q", "dq", "tau_J", "tau_J_d", "dtau_J", "theta", "dtheta", "tau_ext_hat_filtered", "O_T_EE")


def program_path(name: str) -> Path:
    """Return the file of a foreign client's program, such as aiofranka."""
    return CLIENTS / f"{name}_program.py"


def connect(address: str) -> franka.Robot:
    """Connect without asking for a real-time kernel."""
    return franka.Robot(address, franka.RealtimeConfig.kIgnore)


def measured(state: franka.RobotState) -> np.ndarray:
    """The measured fields, one after the other."""
    return np.concatenate([np.ravel(getattr(state, name)) for name in MEASURED])


def hold(state: franka.RobotState, q_hold: np.ndarray) -> np.ndarray:
    """A joint impedance, (7,), Nm."""
    return STIFFNESS * (q_hold - state.q) - DAMPING * np.array(state.dq)


def torque_control(
    robot: franka.Robot, ticks: int, law: Callable[[int, franka.RobotState], np.ndarray]
) -> list[franka.RobotState]:
    """Control with `law(tick, state)`, finish, and return the states. Raises what pylibfranka raises."""
    control, states = robot.start_torque_control(), []
    for tick in range(ticks):
        state, _ = control.readOnce()
        states.append(state)
        command = franka.Torques(list(law(tick, state)))
        command.motion_finished = tick == ticks - 1
        control.writeOnce(command)
    return states


def move_to(robot: franka.Robot, goal: np.ndarray, ticks: int = 3000) -> None:
    """Move to a goal, (7,) rad, with the joint-position generator, at rest at both ends.

    The path goes by the robot's time: a ms that was lost is one that the robot has bridged.
    """
    control = robot.start_joint_position_control(franka.ControllerMode.JointImpedance)
    state, _ = control.readOnce()
    start, tick = np.array(state.q_d), 0
    while True:
        command = franka.JointPositions(list(start + smooth(min(tick / ticks, 1.0)) * (goal - start)))
        command.motion_finished = tick >= ticks
        control.writeOnce(command)
        if command.motion_finished:
            return
        _, period = control.readOnce()
        tick += max(1, round(1e3 * period.to_sec()))


def smooth(s: float) -> float:
    """Share of the way after a share of the time: at rest at both ends, acceleration too."""
    return 10 * s**3 - 15 * s**4 + 6 * s**5


def go_home(robot: franka.Robot, offset: np.ndarray | float = 0.0, side: str = "left") -> None:
    """Move to the scene's start pose plus an offset, (7,) rad, with the joint-position generator."""
    move_to(robot, np.array(getattr(load_scene(), side).home) + offset)
