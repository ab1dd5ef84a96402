"""Clients that come and go, two at once, and a motion that only C++ offers, as its examples do it."""

import subprocess
import sys

import numpy as np
import pylibfranka as franka

from sim_robot.fci.protocol import Command, Controller, Generator, MoveStatus
from tests.support.fci.client import connect, program_path
from tests.support.fci.raw import RawClient
from tests.support.fci.server import Served

RECONNECTS = 100
TICKS = 1000
JOINT = 3


def program(name: str, address: str, *parts: str) -> subprocess.Popen[str]:
    command = [sys.executable, str(program_path(name)), address, *parts]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def test_a_client_that_comes_back_a_hundred_times(lockstep: Served) -> None:
    """Each time it moves; every third time it goes without finishing its motion, every fourth without a word."""
    for turn in range(RECONNECTS):
        robot = connect(lockstep.left)
        assert robot.read_once().robot_mode == franka.RobotMode.Idle, turn
        control = robot.start_torque_control()
        for tick in range(10):
            state, _ = control.readOnce()
            command = franka.Torques([0.0] * 7)
            command.motion_finished = tick == 9 and turn % 3 != 0
            control.writeOnce(command)
        assert state.control_command_success_rate == 1.0
        del control, robot
        if turn % 4 == 0:
            with RawClient(lockstep.left) as raw:
                raw.connect()


def test_two_clients_on_two_arms(lockstep: Served) -> None:
    """Two processes, each unaware of the other."""
    parts = ("finished_in_the_middle", "impedance", "ready", "consecutive")
    both = [program("pylibfranka", address, *parts) for address in (lockstep.left, lockstep.right)]
    for client in both:
        said, _ = client.communicate(timeout=120)
        assert client.returncode == 0, said


def test_a_motion_with_the_clients_own_controller(lockstep: Served) -> None:
    """Joint velocities, and beside them the torques that follow them."""
    stiffness, damping = np.full(7, 200.0), np.full(7, 10.0)
    with RawClient(lockstep.left) as raw:
        first = state = raw.begin(Controller.EXTERNAL, Generator.JOINT_VELOCITY)
        for tick in range(TICKS + 1):
            velocity = np.zeros(7)
            velocity[JOINT] = 0.2 * (1.0 - np.cos(2.0 * np.pi * tick / TICKS))
            torque = stiffness * (state["q_d"] - state["q"]) + damping * (state["dq_d"] - state["dq"])
            end = int(tick == TICKS)
            raw.command(
                state, dq_c=velocity, tau_J_d=torque, motion_generation_finished=end, torque_command_finished=end
            )
            state = raw.state()
        command, _, body = raw.answer()
        assert (command, body[0]) == (Command.MOVE, MoveStatus.SUCCESS)
        way = state["q"] - first["q"]
        assert abs(way[JOINT] - 0.2) < 0.02
        assert np.abs(np.delete(way, JOINT)).max() < 0.02
