"""What libfranka's examples do, over pylibfranka; those of each motion generator: tests/fci/test_motions.py.

`python pylibfranka_program.py ADDRESS [PART...]` prints a line for each part that went well; without parts, all.
"""

import itertools
import sys
import time
from collections.abc import Callable

import numpy as np
import pylibfranka as franka

JOINT = franka.ControllerMode.JointImpedance
READY = np.pi * np.array([0.0, -1 / 4, 0.0, -3 / 4, 0.0, 1 / 2, 1 / 4])
Law = Callable[[franka.RobotState, float], object]


def run(control: franka.ActiveControlBase, law: Law, seconds: float) -> tuple[franka.RobotState, franka.RobotState]:
    """Command law(first state, time in s); return the first state and the last one."""
    first, ticks = None, round(1e3 * seconds)
    for tick in range(ticks + 1):
        state, _ = control.readOnce()
        first = state if first is None else first
        command = law(first, 1e-3 * tick)
        command.motion_finished = tick == ticks
        control.writeOnce(command)
    return first, state


def cycle(time: float, period: float) -> float:
    """0 to 1 and back within each period, s; at rest at both ends."""
    return 0.5 * (1.0 - np.cos(2.0 * np.pi * time / period))


def ready(robot: franka.Robot) -> None:
    """From where the arm is measured to the pose in which the examples begin."""

    def law(first: franka.RobotState, time: float) -> franka.JointPositions:
        return franka.JointPositions(list(first.q + cycle(time, 6.0) * (READY - first.q)))

    _, last = run(robot.start_joint_position_control(JOINT), law, 3.0)
    assert np.abs(last.q - READY).max() < 3e-3


def asynchronous(robot: franka.Robot) -> None:
    """Targets now and then; the robot finds the way there."""
    handler = franka.AsyncPositionControlHandler
    goal = np.array(robot.read_once().q) + 0.05 * np.array([0.5, -1.0, 0.5, 0.0, 1.0, 1.0, 1.0])
    result = handler.configure(robot, handler.Configuration([0.655] * 4 + [1.315] * 3, goal_tolerance=0.01))
    assert result.error_message is None, result.error_message
    for _ in range(200):
        feedback = result.handler.get_target_feedback()
        assert feedback.error_message is None, feedback.error_message
        target = handler.JointPositionTarget(joint_positions=list(goal))
        assert result.handler.set_joint_position_target(target).was_successful
        time.sleep(5e-3)
    result.handler.stop_control()
    assert np.abs(np.array(robot.read_once().q) - goal).max() < 3e-3


def echo_state(robot: franka.Robot) -> None:
    """Read for a while; the robot's time goes on."""
    states = [robot.read_once() for _ in range(20)]
    assert all(before.time.to_sec() < after.time.to_sec() for before, after in itertools.pairwise(states))


def finished_in_the_middle(robot: franka.Robot) -> None:
    """Torque control dropped while it runs stops the motion; the next one starts."""
    control = robot.start_torque_control()
    for _ in range(50):
        control.readOnce()
        control.writeOnce(franka.Torques([0.0] * 7))
    del control
    assert robot.read_once().robot_mode == franka.RobotMode.Idle


def impedance(robot: franka.Robot) -> None:
    """A Cartesian spring with the model's Jacobian and Coriolis torques."""
    model, start = robot.load_model(), np.array(robot.read_once().O_T_EE[12:15])
    control, position = robot.start_torque_control(), start
    for tick in range(500):
        state, _ = control.readOnce()
        position = np.array(state.O_T_EE[12:15])
        J, dq = np.array(model.zero_jacobian(state)).reshape(7, 6).T, np.array(state.dq)
        wrench = np.concatenate([150.0 * (start - position), np.zeros(3)]) - [25, 25, 25, 2.5, 2.5, 2.5] * (J @ dq)
        command = franka.Torques(list(J.T @ wrench + np.array(model.coriolis(state))))
        command.motion_finished = tick == 499
        control.writeOnce(command)
    assert np.linalg.norm(position - start) < 0.01


def force(robot: franka.Robot) -> None:
    """Lean on the table by a kilogram's weight: the estimate shows it, less what friction takes."""
    model, control = robot.load_model(), robot.start_torque_control()
    integral, tau_start = np.zeros(7), None
    for tick in range(6000):
        state, _ = control.readOnce()
        J = np.array(model.zero_jacobian(state)).reshape(7, 6).T
        tau_ext = np.array(state.tau_J) - np.array(model.gravity(state))
        tau_start = tau_ext if tau_start is None else tau_start
        wanted = J.T @ np.array([0.0, 0.0, -9.81 * min(1.0, tick / 1000), 0.0, 0.0, 0.0])
        integral += 1e-3 * (wanted - tau_ext + tau_start)
        command = franka.Torques(list(wanted + integral - 2.0 * np.array(state.dq)))
        command.motion_finished = tick == 5999
        control.writeOnce(command)
    assert max(state.cartesian_contact) == 0.0
    assert -20.0 < state.O_F_ext_hat_K[2] < -3.0


def consecutive(robot: franka.Robot) -> None:
    """Joint velocities three times, one after the other."""

    def law(first: franka.RobotState, time: float) -> franka.JointVelocities:
        return franka.JointVelocities([0.0] * 6 + [0.1 * cycle(time, 0.5)])

    for _ in range(3):
        run(robot.start_joint_velocity_control(JOINT), law, 0.5)


PARTS = {
    part.__name__: part
    for part in (
        asynchronous, echo_state, finished_in_the_middle, impedance, force, consecutive, ready,
    )
}  # fmt: skip


if __name__ == "__main__":
    robot = franka.Robot(sys.argv[1], franka.RealtimeConfig.kIgnore)
    robot.set_collision_behavior([20.0] * 7, [100.0] * 7, [20.0] * 6, [100.0] * 6)
    for name in sys.argv[2:] or PARTS:
        PARTS[name](robot)
        print(name, flush=True)
