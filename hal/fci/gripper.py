"""The Franka Hand at an arm's address, over pylibfranka: a hal.gripper.Gripper.

pylibfranka keeps Python's lock while a command runs (homing, a move: seconds), so that no other thread of the process
goes on: a process that controls arms leaves the gripper to another process.
"""

import socket
import time
from typing import Any

import pylibfranka as franka

from hal.errors import ConnectionLost, GripperAborted, GripperFailed, HardwareError, NoGripper
from hal.fci.faults import vendor_errors
from hal.fci.sockets import exchange
from hal.gripper import GripperState
from hal.wire import CONNECT, GRIPPER_HEADER, GRIPPER_PORT, GRIPPER_VERSION

_CONNECT_COMMAND, _SUCCESS, _INCOMPATIBLE = 0, 0, 1
PATIENCE_S = 1.0  # libfranka's own


def ask_for_gripper(address: str) -> int:
    """Return the version of the gripper at an arm's address, asked for as libfranka asks, and hang up again.

    libfranka itself would wait for ever where the other end hangs up. Raises NoGripper, ConnectionLost, HardwareError.
    """
    try:
        with (
            socket.create_connection((address, GRIPPER_PORT), PATIENCE_S) as tcp,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp,
        ):
            udp.bind(("", 0))
            asked, due_s = CONNECT.pack(GRIPPER_VERSION, udp.getsockname()[1]), time.monotonic() + PATIENCE_S
            answer = exchange(tcp, GRIPPER_HEADER, _CONNECT_COMMAND, asked, due_s, CONNECT.size)
    except ConnectionResetError:
        raise ConnectionLost(f"the gripper at {address} hung up; is one mounted, and known to Desk?") from None
    except OSError as error:
        raise ConnectionLost(
            f"no gripper answers at {address}: {error.strerror or error}; is one mounted, and the FCI active in Desk?"
        ) from None
    status, version = CONNECT.unpack_from(answer)
    if status == _INCOMPATIBLE:
        raise HardwareError(
            f"the gripper at {address} speaks version {version}, this libfranka {GRIPPER_VERSION}; "
            "update the robot's system"
        )
    if status != _SUCCESS:
        raise NoGripper(f"the robot at {address} has no hand: mount one, in simulation by a scene with [left.hand]")
    return version


class FciGripper:
    """The hand of the arm at `address`."""

    def __init__(self, address: str) -> None:
        """Connect. Raises NoGripper, ConnectionLost, HardwareError."""
        self.address = address
        ask_for_gripper(address)
        with vendor_errors(self.address, _explained):
            self._gripper: franka.Gripper | None = franka.Gripper(address)

    def state(self) -> GripperState:
        """Return the next state. See hal.gripper.Gripper."""
        state = self._ask("read_once")
        t_ns = round(1e3 * state.time.to_sec()) * 1_000_000
        return GripperState(t_ns, state.width, state.max_width, state.is_grasped, state.temperature)

    def homing(self) -> bool:
        """Find the largest width."""
        return self._ask("homing")

    def move(self, width: float, speed: float) -> bool:
        """Bring the fingers to a width, m, at a speed, m/s."""
        return self._ask("move", width, speed)

    def grasp(
        self, width: float, speed: float, force: float, epsilon_inner: float = 0.005, epsilon_outer: float = 0.005
    ) -> bool:
        """Close until a force, N, is felt, and hold on."""
        return self._ask("grasp", width, speed, force, epsilon_inner, epsilon_outer)

    def stop(self) -> bool:
        """Let go."""
        return self._ask("stop")

    def close(self) -> None:
        """Disconnect."""
        self._gripper = None

    def _ask(self, command: str, *values: float) -> Any:
        if self._gripper is None:
            raise ConnectionLost(f"the gripper at {self.address} was closed; open it again")
        with vendor_errors(self.address, _explained):
            return getattr(self._gripper, command)(*values)


def _explained(error: Exception, address: str) -> HardwareError:
    text = " ".join(str(error).removeprefix("libfranka: ").removeprefix("libfranka gripper: ").split())
    if isinstance(error, franka.NetworkException):
        return ConnectionLost(f"the gripper at {address} does not answer: {text}; check power and cable")
    if isinstance(error, franka.CommandException) and "aborted" in text:
        return GripperAborted(f"the gripper at {address}: {text} Another command or stop ended it")
    if isinstance(error, franka.CommandException):
        return GripperFailed(f"the gripper at {address}: {text} Is it homed, the width within its range?")
    return HardwareError(f"the gripper at {address}: {text}")
