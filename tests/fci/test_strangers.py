"""Who hangs up, lies about sizes, sends half a message or is not the client harms nobody."""

import socket
import struct

import numpy as np
import pylibfranka as franka
import pytest

from hal.wire import HEADER, PORT
from sim_robot.fci.protocol import Command, ConnectStatus
from tests.support.fci.client import connect, hold, torque_control
from tests.support.fci.raw import RawClient
from tests.support.fci.server import Served


def assert_serves(served: Served) -> None:
    """An honest client of each arm is served."""
    for address in (served.left, served.right):
        robot = connect(address)
        q_hold = np.array(robot.read_once().q)
        states = torque_control(robot, 30, lambda tick, state, q_hold=q_hold: hold(state, q_hold))
        assert states[-1].robot_mode == franka.RobotMode.Move


@pytest.mark.parametrize(
    "message",
    [
        HEADER.pack(Command.SET_LOAD, 1, 0xFFFFFFFF),
        HEADER.pack(Command.GET_ROBOT_MODEL, 1, 3),
        HEADER.pack(77, 1, HEADER.size),
        HEADER.pack(Command.MOVE, 1, HEADER.size),
        bytes(range(256)) * 64,
        b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n",
    ],
)
def test_what_cannot_be_trusted_closes_the_connection(lockstep: Served, message: bytes) -> None:
    for say_connect in (False, True):
        with RawClient(lockstep.left) as raw:
            if say_connect:
                raw.connect()
            raw.tcp.sendall(message)
            with pytest.raises(ConnectionError):
                raw.answer()
    assert_serves(lockstep)


def test_half_a_message_waits_for_its_other_half(lockstep: Served) -> None:
    with RawClient(lockstep.left) as raw:
        raw.connect()
        whole = HEADER.pack(Command.AUTOMATIC_ERROR_RECOVERY, 9, HEADER.size)
        raw.tcp.sendall(whole[:7])
        raw.state()
        raw.tcp.sendall(whole[7:])
        assert raw.answer() == (Command.AUTOMATIC_ERROR_RECOVERY, 9, b"\x00")
        raw.tcp.sendall(whole[:5])  # and hangs up
    assert_serves(lockstep)


def test_a_wrong_version_is_told_so(lockstep: Served) -> None:
    with RawClient(lockstep.left) as raw:
        assert raw.connect(version=5) == struct.pack("<BH", 1, 10)


def test_a_second_client_is_turned_away_and_the_first_goes_on(lockstep: Served) -> None:
    robot = connect(lockstep.left)
    q_hold = np.array(robot.read_once().q)

    def law(tick: int, state: franka.RobotState) -> np.ndarray:
        if tick % 50 == 0:
            with RawClient(lockstep.left) as second:
                assert second.connect()[0] == ConnectStatus.TAKEN
        return hold(state, q_hold)

    assert torque_control(robot, 200, law)[-1].control_command_success_rate == 1.0


def test_a_second_pylibfranka_is_told_and_does_not_wait(lockstep: Served) -> None:
    first = connect(lockstep.left)
    with pytest.raises(Exception, match="Protocol error"):
        connect(lockstep.left)
    assert first.read_once().robot_mode == franka.RobotMode.Idle


def test_datagrams_that_are_no_commands_are_dropped(lockstep: Served) -> None:
    with RawClient(lockstep.left) as raw, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        raw.begin()
        for tick in range(50):
            state = raw.state()
            assert state["robot_mode"] == franka.RobotMode.Move.value
            for size in (0, 1, 370, 372, 4000):
                raw.throw(bytes(size))
            stranger.sendto(bytes(371), (lockstep.left, PORT))
            raw.command(state, message_id=state["message_id"] + 1000)  # an answer to what was never asked
            raw.command(state, torque_command_finished=tick == 49)
        assert raw.answer()[2] == b"\x00"


def test_a_client_that_dies_while_it_moves_leaves_a_reflex_and_the_other_arm_goes_on(lockstep: Served) -> None:
    other = connect(lockstep.right)
    q_hold = np.array(other.read_once().q)
    raw = RawClient(lockstep.left)
    raw.connect()
    raw.move()

    def law(tick: int, state: franka.RobotState) -> np.ndarray:
        if tick < 20:
            raw.command(raw.state())
        elif tick == 20:
            raw.close()
        return hold(state, q_hold)

    assert torque_control(other, 200, law)[-1].control_command_success_rate == 1.0
    heir = connect(lockstep.left)
    state = heir.read_once()
    assert state.robot_mode == franka.RobotMode.Reflex
    assert state.current_errors.communication_constraints_violation
    heir.automatic_error_recovery()
    del heir, other
    assert_serves(lockstep)
