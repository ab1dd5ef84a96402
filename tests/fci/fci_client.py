"""Small client programs over pylibfranka that several tests run."""

from collections.abc import Callable

import numpy as np
import pylibfranka as franka

MEASURED = ("q", "dq", "tau_J", "tau_J_d", "dtau_J", "theta", "dtheta", "tau_ext_hat_filtered", "O_T_EE")


def connect(address: str) -> franka.Robot:
    """Connect without asking for a real-time kernel."""
    return franka.Robot(address, franka.RealtimeConfig.kIgnore)


def measured(state: franka.RobotState) -> np.ndarray:
    """The measured fields, one after the other."""
    return np.concatenate([np.ravel(getattr(state, name)) for name in MEASURED])


def hold(state: franka.RobotState, q_hold: np.ndarray) -> np.ndarray:
    """A joint impedance, (7,), Nm."""
    return 200.0 * (q_hold - state.q) - 20.0 * np.array(state.dq)


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
