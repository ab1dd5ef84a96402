"""The limits that a robot has itself: those of the URDF that it answers GetRobotModel with.

libfranka asks for this file when it connects, and keeps it to itself: it is asked for beside it, on a connection of its
own, before. Layout: libfranka-common, research_interface/robot/service_types.h.
"""

import socket
import struct
import xml.etree.ElementTree as xml

import numpy as np

from hal.errors import ConnectionLost, HardwareError
from hal.limits import DOF, OwnLimits
from hal.wire import CONNECT, HEADER, PORT, VERSION

PATIENCE_S = 3.0
_CONNECT_COMMAND, _MODEL_COMMAND = 0, 11


def ask_for_urdf(address: str) -> str:
    """Return the URDF of the robot at an address, which no client is connected to. Raises ConnectionLost."""
    try:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as states,
            socket.create_connection((address, PORT), PATIENCE_S) as arm,
        ):
            states.bind(("", 0))
            body = CONNECT.pack(VERSION, states.getsockname()[1])
            answer = b""
            for command, asked in ((_CONNECT_COMMAND, body), (_MODEL_COMMAND, b"")):
                arm.sendall(HEADER.pack(command, command + 1, HEADER.size + len(asked)) + asked)
                size = HEADER.unpack(_receive(arm, HEADER.size))[2]
                answer = _receive(arm, size - HEADER.size)
    except (OSError, struct.error) as error:
        raise ConnectionLost(
            f"the arm at {address} does not answer with its model: {error}; check power, cable and FCI mode in Desk"
        ) from None
    return answer[1:].rstrip(b"\0").decode(errors="replace")


def _receive(arm: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        chunk = arm.recv(size - len(data))
        if not chunk:
            raise ConnectionResetError("it hung up")
        data += chunk
    return data


def limits_in(urdf: str, arm: str) -> OwnLimits:
    """Return the limits of the first seven joints that have any. Raises HardwareError with one line."""
    try:
        limits = [limit for joint in xml.fromstring(urdf).iter("joint") if (limit := joint.find("limit")) is not None]
        columns = [
            np.array([float(limit.attrib[name]) for limit in limits[:DOF]])
            for name in ("lower", "upper", "velocity", "effort")
        ]
    except (xml.ParseError, KeyError, ValueError) as error:
        raise HardwareError(f"the model that {arm} tells cannot be read: {error}") from None
    if len(limits) < DOF or not np.isfinite(columns).all():
        raise HardwareError(f"the model that {arm} tells has no limits of {DOF} joints")
    return OwnLimits(*columns)
