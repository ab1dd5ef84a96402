"""An arm that is answered while this process is blocked: with its last command, until it leaves its bounds."""

import socket
import time

import numpy as np
import pytest

from hal.fci.hold import FASTER_RAD_S, FURTHER_RAD, HoldThread
from hal.limits import CollisionBehaviour, HoldBounds
from hal.wire import ROBOT_COMMAND, ROBOT_STATE

PATIENCE_S = 20.0
TORQUE = np.arange(1.0, 8.0)
BOUNDS = HoldBounds((-1.0,) * 7, (1.0,) * 7, (2.0,) * 7, (20.0,) * 4 + (10.0,) * 3, 50.0)


class _Arm:
    """A client's end of an arm's channel."""

    def __init__(self, end, bounds=BOUNDS):
        self.socket, self.hold_bounds, self.let_go = end.fileno(), bounds, "as before"

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


def shown(ends, number, speed=0.0, **fields):
    """Show a state: speed of joint 4, rad/s; fields: name = (component, value)."""
    robot, client = ends
    state = np.zeros(1, ROBOT_STATE)
    state["message_id"] = number
    state["dq"][0, 3] = speed
    for name, (component, value) in fields.items():
        state[name][0, component] = value
    robot.sendto(state.tobytes(), client.getsockname())


def ended(hold):
    """Return whether a hold ends by itself."""
    end_s = time.monotonic() + PATIENCE_S
    while not hold.ended and time.monotonic() < end_s:
        time.sleep(1e-3)
    return hold.ended


def test_it_is_answered_with_its_last_command(ends, thread):
    arm = _Arm(ends[1])
    with thread.hold(arm) as hold:
        for number in range(5):
            shown(ends, number, 0.5)
            (command,) = np.frombuffer(ends[0].recv(2048), ROBOT_COMMAND)
            assert command["message_id"] == number
            assert np.array_equal(command["tau_J_d"], TORQUE)
    assert hold.answers == 5
    assert arm.let_go == ""


@pytest.mark.parametrize("faster", [0.5 + 1.01 * FASTER_RAD_S, -0.5 - 1.01 * FASTER_RAD_S, np.nan])
def test_it_is_let_go_where_it_gets_faster(ends, thread, faster):
    arm = _Arm(ends[1])
    with thread.hold(arm) as hold:
        for number, dq in enumerate((0.5, 0.5 + 0.99 * FASTER_RAD_S)):
            shown(ends, number, dq)
            ends[0].recv(2048)
        shown(ends, 2, faster)
        assert ended(hold)
        shown(ends, 3, 0.0)  # and not taken up again
    assert hold.answers == 2
    said = f" (held for 2 ms while the other arm's box was awaited, then let go: joint 4 moves at {faster:.3g} rad/s"
    assert arm.let_go == f"{said}, allowed 0.7)"


DERIVED = CollisionBehaviour(collision_torques=(30.0,) * 7, collision_forces=(60.0,) * 3 + (9.0,) * 3).hold_bounds


@pytest.mark.parametrize(
    ("bounds", "inside", "outside", "said"),
    [
        (BOUNDS, {"q": (1, 0.995)}, {"q": (1, 1.004)}, "joint 2 is at 1.004 rad, allowed 1"),
        (BOUNDS, {"q": (1, -0.995)}, {"q": (1, -1.004)}, "joint 2 is at -1.004 rad, allowed -1"),
        (BOUNDS, {"q": (2, 0.0)}, {"q": (2, 1.1 * FURTHER_RAD)}, "joint 3 has moved by 0.022 rad, allowed 0.02"),
        (BOUNDS, {"q": (2, 0.0)}, {"q": (2, np.nan)}, "joint 3 has moved by nan rad, allowed 0.02"),
        (BOUNDS, {"dq": (6, 1.95)}, {"dq": (6, 2.05)}, "joint 7 moves at 2.05 rad/s, allowed 2"),
        (BOUNDS, {"tau_ext_hat_filtered": (4, -9.9)}, {"tau_ext_hat_filtered": (4, -10.5)},
         "joint 5 feels -10.5 Nm, allowed 10"),
        (BOUNDS, {"O_F_ext_hat_K": (2, 49.0)}, {"O_F_ext_hat_K": (2, -51.0)}, "the pad pushes with 51 N, allowed 50"),
        (DERIVED, {"q": (1, 9.0), "dq": (2, 9.0)}, {"tau_ext_hat_filtered": (6, 31.0), "q": (1, 9.0)},
         "joint 7 feels 31 Nm, allowed 30"),
        (DERIVED, {"O_F_ext_hat_K": (0, 59.0)}, {"O_F_ext_hat_K": (0, 61.0)}, "the pad pushes with 61 N, allowed 60"),
    ],
)  # fmt: skip
def test_it_is_let_go_outside_each_bound(ends, thread, bounds, inside, outside, said):
    arm = _Arm(ends[1], bounds)
    with thread.hold(arm) as hold:
        for number in range(3):
            shown(ends, number, **inside)
            ends[0].recv(2048)
        shown(ends, 3, **outside)
        assert ended(hold)
    assert hold.answers == 3
    assert arm.let_go == f" (held for 3 ms while the other arm's box was awaited, then let go: {said})"


def test_an_arm_that_begins_beyond_its_range_is_held_there(ends, thread):
    """As one that a hand leads out of a limit."""
    with thread.hold(_Arm(ends[1])) as hold:
        for number, q in enumerate((1.1, 1.11)):
            shown(ends, number, q=(0, q))
            ends[0].recv(2048)
        shown(ends, 2, q=(0, 1.1 + 1.1 * FURTHER_RAD))
        assert ended(hold)
    assert hold.answers == 2
