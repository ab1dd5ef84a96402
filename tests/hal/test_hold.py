"""An arm that is answered while this process is blocked: with its last command, until it gets faster."""

import socket
import time

import numpy as np
import pytest

from hal.fci.hold import FASTER_RAD_S, HoldThread
from hal.wire import ROBOT_COMMAND, ROBOT_STATE

PATIENCE_S = 20.0
TORQUE = np.arange(1.0, 8.0)


class _Arm:
    """A client's end of an arm's channel."""

    def __init__(self, end):
        self.socket = end.fileno()

    def last_torque(self):
        return TORQUE


@pytest.fixture
def ends():
    """The robot's socket and the client's, on loopback."""
    with socket.socket(type=socket.SOCK_DGRAM) as robot, socket.socket(type=socket.SOCK_DGRAM) as client:
        for end in (robot, client):
            end.bind(("127.0.0.1", 0))
        robot.settimeout(PATIENCE_S)
        yield robot, client


@pytest.fixture
def thread():
    thread = HoldThread()
    yield thread
    thread.close()


def shown(ends, number, dq):
    """Show a state of a joint's velocity, rad/s."""
    robot, client = ends
    state = np.zeros(1, ROBOT_STATE)
    state["message_id"] = number
    state["dq"][0, 3] = dq
    robot.sendto(state.tobytes(), client.getsockname())


def test_it_is_answered_with_its_last_command(ends, thread):
    with thread.hold(_Arm(ends[1])) as hold:
        for number in range(5):
            shown(ends, number, 0.5)
            (command,) = np.frombuffer(ends[0].recv(2048), ROBOT_COMMAND)
            assert command["message_id"] == number
            assert np.array_equal(command["tau_J_d"], TORQUE)
    assert hold.answers == 5


@pytest.mark.parametrize("faster", [0.5 + 1.01 * FASTER_RAD_S, -0.5 - 1.01 * FASTER_RAD_S, np.nan])
def test_it_is_let_go_where_it_gets_faster(ends, thread, faster):
    with thread.hold(_Arm(ends[1])) as hold:
        for number, dq in enumerate((0.5, 0.5 + 0.99 * FASTER_RAD_S)):
            shown(ends, number, dq)
            ends[0].recv(2048)
        shown(ends, 2, faster)
        end_s = time.monotonic() + PATIENCE_S
        while not hold.ended and time.monotonic() < end_s:
            time.sleep(1e-3)
        assert hold.ended
        shown(ends, 3, 0.0)  # and not taken up again
    assert hold.answers == 2
