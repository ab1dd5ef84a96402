"""The ports of the grippers: 1338, version 3, of the Franka Hand; 1339, version 1, of the vacuum gripper.

Where no such gripper is mounted Connect is refused, and a connection that is ended here is reset: see
docs/reference/compatibility.md. Source: libfranka-common, research_interface/gripper and vacuum_gripper. Chosen here:
several clients, and ten states a second.
"""

import contextlib
import socket
import struct
import time

from hal.wire import GRIPPER_HEADER, GRIPPER_PORT, GRIPPER_VERSION
from sim_robot.fci.poller import Poller
from sim_robot.fci.port import Port, Session
from sim_robot.gripper import ROOM_TEMPERATURE
from sim_robot.hand import Hand, Order

STATE = struct.Struct("<IddBH")  # message id, width m, largest width m, is grasped, temperature deg C
STATE_PERIOD_S = 0.1
_CONNECT, _HOMING, _GRASP, _MOVE, _STOP = range(5)
_PAYLOADS = {
    _CONNECT: struct.Struct("<HH"),  # version, the client's UDP port
    _HOMING: struct.Struct("<"),
    _GRASP: struct.Struct("<5d"),  # width, inner and outer tolerance, speed, force
    _MOVE: struct.Struct("<2d"),  # width, speed
    _STOP: struct.Struct("<"),
}
_SUCCESS, _INCOMPATIBLE = 0, 1
NOT_MOUNTED = 2  # not the vendor's, who has only the two above
MOST_CLIENTS = 4
_RESET = struct.pack("ii", 1, 0)  # SO_LINGER, socket(7)


class GripperPort(Port):
    """One gripper's port at one arm's address. hand: None where none is mounted."""

    header, payloads, most = GRIPPER_HEADER, _PAYLOADS, MOST_CLIENTS

    def __init__(
        self, poller: Poller, address: str, hand: Hand | None, port: int = GRIPPER_PORT, version: int = GRIPPER_VERSION
    ) -> None:
        super().__init__(poller, address, port)
        self._hand, self._version = hand, version
        self._targets: dict[Session, tuple[str, int]] = {}  # where the states of each client go
        self._orders: list[tuple[Session, int, int, Order]] = []  # who waits: client, command, its id
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.setblocking(False)
        self._udp.bind((address, 0))
        self._message_id = 0
        self._state_due_s = 0.0

    @property
    def in_use(self) -> bool:
        return bool(self._targets)

    def _set_up(self, tcp: socket.socket) -> None:
        tcp.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)

    def _is_client(self, session: Session) -> bool:
        return session in self._targets

    def _gone(self, session: Session) -> None:
        """Forget a client. What it has ordered goes on."""
        self._targets.pop(session, None)
        self._orders = [waiting for waiting in self._orders if waiting[0] is not session]

    def _dispatch(self, session: Session, command: int, command_id: int, values: tuple) -> None:
        if command == _CONNECT:
            self._connect(session, command_id, *values)
        elif self._hand is None or session not in self._targets:
            self._distrust(session)
        else:
            if command == _GRASP:
                width, inner, outer, speed, force = values
                values = width, speed, force, inner, outer
            hand = self._hand
            ordered = {_HOMING: hand.homing, _GRASP: hand.grasp, _MOVE: hand.move, _STOP: hand.stop}[command]
            self._orders.append((session, command, command_id, ordered(*values)))
            self.settle()

    def _connect(self, session: Session, command_id: int, version: int, port: int) -> None:
        status = _SUCCESS
        if version != self._version:
            status = _INCOMPATIBLE
        elif self._hand is None:
            status = NOT_MOUNTED
        else:
            self._targets[session] = (session.address, port)
        self._answer(session, _CONNECT, command_id, struct.pack("<HH", status, self._version))

    def settle(self) -> None:
        """Answer whose command has ended, in the order in which they came."""
        ended = [waiting for waiting in self._orders if waiting[3].outcome is not None]
        if ended:
            self._orders = [waiting for waiting in self._orders if waiting[3].outcome is None]
            for session, command, command_id, order in ended:
                self._answer(session, command, command_id, struct.pack("<H", order.outcome))

    def show(self) -> None:
        """Send the state to who is connected, ten times a second however often it is called."""
        if self._hand is None or not self._targets or time.monotonic() < self._state_due_s:
            return
        self._state_due_s = time.monotonic() + STATE_PERIOD_S
        # ms since the robot's start, which the client reads as the state's time
        self._message_id = max(self._message_id + 1, self._hand.ticks)
        hand = self._hand
        state = STATE.pack(self._message_id, hand.width, hand.max_width, hand.is_grasped, ROOM_TEMPERATURE)
        for target in self._targets.values():
            with contextlib.suppress(OSError):
                self._udp.sendto(state, target)

    def close(self) -> None:
        self.listen(False)
        self._udp.close()
