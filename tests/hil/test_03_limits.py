"""03 limits: the robot has the limits that we count on, and refuses what breaks them."""

import socket
import struct
import xml.etree.ElementTree as xml
from collections.abc import Callable

import numpy as np
import pytest

from hal.cell import LEFT, RIGHT
from hal.errors import CommandRejected
from hal.fci import FciPair
from hal.robots import FR3
from hal.state import RobotMode
from tests.support.hil.robot import Robot

PORT, VERSION = 1337, 10
HEADER = struct.Struct("<III")
CONNECT, GET_ROBOT_MODEL = 0, 11
STEP_NM = 40.0  # in one tick, where the robot takes 1
TICKS = 20


def model_of(address: str) -> xml.Element:
    """Ask an arm for its model, as libfranka does, which keeps it to itself."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as states, socket.create_connection((address, PORT)) as arm:
        states.bind(("0.0.0.0", 0))
        for command, body in ((CONNECT, struct.pack("<HH", VERSION, states.getsockname()[1])), (GET_ROBOT_MODEL, b"")):
            arm.sendall(HEADER.pack(command, command + 1, HEADER.size + len(body)) + body)
            head = HEADER.unpack(arm.recv(HEADER.size, socket.MSG_WAITALL))
            answer = arm.recv(head[2] - HEADER.size, socket.MSG_WAITALL)
        return xml.fromstring(answer[1:].rstrip(b"\0").decode())


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_robots_limits_are_those_we_keep(robot, side, record_property) -> None:
    joints = [joint for joint in model_of(getattr(robot, side)).iter("joint") if joint.find("limit") is not None][:7]
    found = {
        name: np.array([float(joint.find("limit").attrib[name]) for joint in joints])
        for name in ("lower", "upper", "velocity", "effort")
    }
    ours = {
        "lower": FR3.limits.q_lower,
        "upper": FR3.limits.q_upper,
        "velocity": FR3.limits.dq_max,
        "effort": FR3.limits.tau_max,
    }
    # stricter than the robot is safe, the other way round is a reflex
    spare = {name: (found[name] - ours[name]) * (-1 if name == "lower" else 1) for name in ours}
    for name, values in spare.items():
        record_property(f"{name} to spare", float(values.min()))
        assert values.min() >= -1e-6, (name, values)


def test_a_torque_jump_is_refused_by_name_and_recovered_from(robot: Robot) -> None:
    pair = robot.pair()
    try:
        pair.start()
        assert _refused(lambda: _jump(pair, robot)).errors == ("controller_torque_discontinuity",)
        pair.left.stop()
        pair.right.stop()
        assert pair.left.reflex() == ("controller_torque_discontinuity",)
        assert [line.partition(" has ")[0] for line in pair.recover()] == [f"the left arm at {robot.left}"]
        assert [arm.read().robot_mode for arm in (pair.left, pair.right)] == [RobotMode.IDLE] * 2
    finally:
        pair.close()


def test_a_torque_that_is_no_number_never_leaves(robot: Robot) -> None:
    pair = robot.pair()
    try:
        pair.start()
        pair.left.read()
        assert "NaN" in str(_refused(lambda: pair.left.write(np.full(7, np.nan))))
        pair.recover()  # meanwhile nobody has answered the right arm
    finally:
        pair.close()


def _refused(command: Callable[[], None]) -> CommandRejected:
    """Return what a command is refused with. Its traceback would keep the client connected: it is let go."""
    try:
        command()
    except CommandRejected as error:
        return error.with_traceback(None)
    raise AssertionError("it was not refused")


def _jump(pair: FciPair, robot: Robot) -> None:
    """Answer both arms without a torque of ours; then ask the left one's last joint for too much."""
    arms, step = (pair.left, pair.right), np.array([0.0] * 6 + [STEP_NM])
    answered = [0, 0]
    while min(answered) < TICKS:
        mask = LEFT | RIGHT if robot.simulated else pair.wait()
        ready = [arm for bit, arm in zip((LEFT, RIGHT), arms, strict=True) if mask & bit]
        for arm in ready:
            arm.read()
        for arm in ready:
            side = arms.index(arm)
            arm.write(step if side == 0 and answered[0] > TICKS // 2 else np.zeros(7))
            answered[side] += 1
