"""The gripper's port, 1338, version 3: it answers, truthfully, that no hand is mounted.

A Franka Hand's client connects and asks; every motion fails, and the state shows a width of zero. Only a pad is on the
flange. Source: libfranka, research_interface/gripper.
"""

import contextlib
import socket
import struct
import time
from collections.abc import Callable

from sim_robot.fci.poller import Poller
from sim_robot.fci.protocol import GRIPPER_HEADER, GRIPPER_PORT, GRIPPER_VERSION

STATE = struct.Struct("<IddBH")  # message id, width m, largest width m, is grasped, temperature deg C
ROOM_TEMPERATURE = 25
_CONNECT = 0
# homing, grasp (width, two tolerances, speed, force), move (width, speed), stop
_PAYLOADS = {_CONNECT: 4, 1: 0, 2: 40, 3: 16, 4: 0}
_STOP = 4
_SUCCESS, _FAIL, _INCOMPATIBLE = 0, 1, 1
MOST_CLIENTS = 4
BACKLOG, ACCEPT_PERIOD_S = 128, 0.5e-3  # as in link.py: who waits in the kernel is taken one at a time


class Gripper:
    """The gripper's port at one arm's address. Never blocks, never trusts a size."""

    def __init__(self, poller: Poller, address: str) -> None:
        """Listen. Raises OSError."""
        self._poller, self._address = poller, address
        self._listener = socket.create_server((address, GRIPPER_PORT), backlog=BACKLOG)
        self._listener.setblocking(False)
        # each client: what it sent so far, and where its states go once it has said Connect
        self._inboxes: dict[socket.socket, bytearray] = {}
        self._targets: dict[socket.socket, tuple[str, int]] = {}
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.setblocking(False)
        self._udp.bind((address, 0))
        self._message_id = 0
        self._state_due_s = 0.0
        poller.watch(self._listener, self._accept)

    def _accept(self) -> None:
        self._poller.rest(self._listener, ACCEPT_PERIOD_S)
        try:
            tcp, _ = self._listener.accept()
        except OSError:
            return
        if len(self._inboxes) >= MOST_CLIENTS:
            # who has been silent for longest, if anybody: a client says Connect at once
            silent = next((one for one in self._inboxes if one not in self._targets), None)
            if silent is None:
                tcp.close()
                return
            self._drop(silent)
        tcp.setblocking(False)
        self._inboxes[tcp] = bytearray()
        self._poller.watch(tcp, self._server_of(tcp))

    def _server_of(self, tcp: socket.socket) -> Callable[[], None]:
        return lambda: self._serve(tcp)

    def _drop(self, tcp: socket.socket) -> None:
        self._inboxes.pop(tcp, None)
        self._targets.pop(tcp, None)
        self._poller.forget(tcp)
        tcp.close()

    def _serve(self, tcp: socket.socket) -> None:
        try:
            chunk = tcp.recv(4096)
        except BlockingIOError:
            return
        except OSError:
            chunk = b""
        if not chunk:
            self._drop(tcp)
            return
        inbox = self._inboxes[tcp]
        inbox += chunk
        while len(inbox) >= GRIPPER_HEADER.size:
            command, command_id, size = GRIPPER_HEADER.unpack_from(inbox)
            if command not in _PAYLOADS or size != GRIPPER_HEADER.size + _PAYLOADS[command]:
                self._drop(tcp)
                return
            if len(inbox) < size:
                return
            payload = bytes(inbox[GRIPPER_HEADER.size : size])
            del inbox[:size]
            if not self._answer(tcp, command, command_id, payload):
                self._drop(tcp)
                return

    def _answer(self, tcp: socket.socket, command: int, command_id: int, payload: bytes) -> bool:
        status, body = (_SUCCESS if command == _STOP else _FAIL), b""
        if command == _CONNECT:
            version, port = struct.unpack("<HH", payload)
            status, body = _SUCCESS, struct.pack("<H", GRIPPER_VERSION)
            if version != GRIPPER_VERSION:
                status = _INCOMPATIBLE
            elif port:
                self._targets[tcp] = (tcp.getpeername()[0], port)
        message = GRIPPER_HEADER.pack(command, command_id, GRIPPER_HEADER.size + 2 + len(body))
        try:
            sent = tcp.send(message + struct.pack("<H", status) + body)
        except OSError:
            return False
        return sent == len(message) + 2 + len(body)

    def show(self) -> None:
        """Send the state to who is connected, ten times a second however often it is called."""
        if not self._targets or time.monotonic() < self._state_due_s:
            return
        self._state_due_s = time.monotonic() + 0.1
        self._message_id += 1
        state = STATE.pack(self._message_id, 0.0, 0.0, 0, ROOM_TEMPERATURE)
        for target in self._targets.values():
            with contextlib.suppress(OSError):
                self._udp.sendto(state, target)

    def close(self) -> None:
        """Close every socket."""
        for tcp in tuple(self._inboxes):
            self._drop(tcp)
        self._poller.forget(self._listener)
        self._listener.close()
        self._udp.close()
