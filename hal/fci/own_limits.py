"""The limits that a robot has itself: those of the URDF that it answers GetRobotModel with.

libfranka keeps it to itself: a connection before its own asks for it (research_interface/robot/service_types.h).
"""

import socket
import time
import xml.etree.ElementTree as xml

import numpy as np

from hal.base.arrays import Array
from hal.errors import ConnectionLost, HardwareError
from hal.fci.sockets import exchange
from hal.limits import DOF, OwnLimits
from hal.wire import CONNECT, HEADER, PORT, VERSION

PATIENCE_S = 3.0  # for all answers together
_CONNECT_COMMAND, _MODEL_COMMAND = 0, 11
_SUCCESS = 0


def ask_for_urdf(address: str) -> str:
    """Return the URDF of the robot at an address, which no client is connected to.

    Raises ConnectionLost where it does not answer as a robot does, HardwareError where it refuses.
    """
    due_s = time.monotonic() + PATIENCE_S
    try:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as states,
            socket.create_connection((address, PORT), PATIENCE_S) as arm,
        ):
            states.bind(("", 0))
            body = CONNECT.pack(VERSION, states.getsockname()[1])
            answer = b""
            for command, asked in ((_CONNECT_COMMAND, body), (_MODEL_COMMAND, b"")):
                answer = exchange(arm, HEADER, command, asked, due_s)
                if answer[0] != _SUCCESS:
                    raise HardwareError(f"the arm at {address} does not send its model (status {answer[0]})")
    except OSError as error:
        reason = f"nothing within {PATIENCE_S:g} s" if isinstance(error, TimeoutError) else error.strerror or error
        text = f"the arm at {address} does not answer: {reason}; check power, cable and FCI mode in Desk"
        raise ConnectionLost(text) from None
    return answer[1:].rstrip(b"\0").decode(errors="replace")


def _columns(joints: list[xml.Element], element: str, *attributes: str) -> Array:
    """Return the attributes (n, joints) of an element that each joint has, (0, 0) where none has it. Raises KeyError,
    ValueError."""
    found = [joint.find(element) for joint in joints]
    there = [each for each in found if each is not None]
    if there and len(there) < len(found):
        raise ValueError(f"only {len(there)} of {len(found)} joints have <{element}>")
    columns = [[float(each.attrib[name]) for each in there] for name in attributes]
    return np.array(columns if there else np.empty((0, 0)))


def limits_in(urdf: str, arm: str) -> OwnLimits:
    """Return the limits of the first seven joints that have any.

    A robot without a velocity limit of its own near the position limits (`<position_based_velocity_limits>`) reports
    -dq_max and 0 (ArmLimits.enforced_velocity_law), or leaves the elements out. Raises HardwareError with one line.
    """
    try:
        joints = [joint for joint in xml.fromstring(urdf).iter("joint") if joint.find("limit") is not None][:DOF]
        columns = _columns(joints, "limit", "lower", "upper", "velocity", "effort")
        laws = _columns(joints, "position_based_velocity_limits", "velocity_offset", "deceleration_limit")
    except (xml.ParseError, KeyError, ValueError) as error:
        raise HardwareError(f"the model that {arm} tells cannot be read: {error}") from None
    if len(columns) < 4 or columns.shape[1] < DOF or not np.isfinite(columns).all():
        raise HardwareError(f"the model that {arm} tells has no limits of {DOF} joints")
    if not len(laws) or np.all((laws[0] == -columns[2]) & (laws[1] == 0.0)):
        return OwnLimits(*columns)
    if not np.all((laws[0] >= 0.0) & (laws[0] < columns[2]) & (laws[1] > 0.0) & np.isfinite(laws[1])):
        raise HardwareError(
            f"the model that {arm} tells has position_based_velocity_limits that cannot be: velocity_offset "
            f"{laws[0].tolist()} rad/s, deceleration_limit {laws[1].tolist()} rad/s^2"
        )
    return OwnLimits(*columns, *laws)
