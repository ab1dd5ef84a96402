"""A probe of the pylibfranka that is installed: the layouts that it wants are those of hal/wire.py.

The vendor may change them without a new version number. A raw server offers it states of chosen sizes and contents.
"""

import json
import os
import socket
import struct
import subprocess
import sys
import time
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np

from hal.robot_errors import ROBOT_ERRORS
from hal.robots import FR3
from hal.state import RobotMode
from hal.wire import HEADER, PORT, ROBOT_COMMAND, ROBOT_STATE
from sim_robot.fci.protocol import Command, Controller
from tests.programs.clients import probe_client
from tests.programs.clients.probe_client import TORQUES

WANTS = f"pylibfranka {version('pylibfranka')} wants another layout than hal/wire.py has: "
STATE_BYTES, COMMAND_BYTES = 1377, 371
LONGEST_S = 30.0


@dataclass(frozen=True, slots=True)
class Heard:
    """How the client ended, what it said of itself, what it printed of the state, and the first command it sent."""

    status: int
    complaint: str
    state: dict
    command: bytes


def numbered_state() -> np.ndarray:
    """A state whose every number is another one, and whose errors are every other one."""
    state = np.zeros(1, ROBOT_STATE)
    count = 0
    for name in ROBOT_STATE.names or ():
        kind = ROBOT_STATE[name]
        if kind.base == np.float32:
            size = kind.itemsize // 4
            state[name] = np.arange(count, count + size, dtype=np.float32).reshape(kind.shape)
            count += size
    state["message_id"] = 1000
    state["robot_mode"] = RobotMode.IDLE
    state["errors"][0, ::2] = state["reflex_reason"][0, 1::2] = 1
    return state


class Prop:
    """A server that says yes to everything and sends one state, cut or filled to a size, until its client ends."""

    def __init__(self, state_bytes: int) -> None:
        self._state, self._size = numbered_state(), state_bytes
        self._client_port, self._command = 0, b""
        self._inbox = bytearray()

    def hear(self) -> Heard:
        """Let a real client in a process of its own connect, and return what it made of it."""
        # this process's own address, which no server of another test has
        address = f"127.1.{os.getpid() // 250 % 250}.{1 + os.getpid() % 250}"
        program = [sys.executable, probe_client.__file__, address]
        with (
            socket.create_server((address, PORT)) as listener,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp,
            subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as client,
        ):
            udp.bind((address, 0))
            udp.setblocking(False)
            listener.settimeout(LONGEST_S)
            try:
                with listener.accept()[0] as tcp:
                    self._serve(tcp, udp, address, client)
            finally:
                client.kill()
            printed, complaint = client.communicate()
        state = json.loads(printed) if printed else {}
        return Heard(client.returncode, complaint.strip(), state, self._command)

    def _serve(self, tcp: socket.socket, udp: socket.socket, address: str, client: subprocess.Popen) -> None:
        tcp.settimeout(1e-3)
        ends = time.monotonic() + LONGEST_S
        while client.poll() is None and not self._command:
            assert time.monotonic() < ends, "the client neither ends nor commands"
            self._answer(tcp)
            if self._client_port:
                self._state["message_id"] += 1
                udp.sendto((self._state.tobytes() + bytes(64))[: self._size], (address, self._client_port))
            try:
                self._command = udp.recv(4096)
            except OSError:
                continue

    def _answer(self, tcp: socket.socket) -> None:
        try:
            self._inbox += tcp.recv(4096)
        except OSError:
            return
        while len(self._inbox) >= HEADER.size:
            command, command_id, size = HEADER.unpack_from(self._inbox)
            payload = bytes(self._inbox[HEADER.size : size])
            del self._inbox[:size]
            body = b"\0"
            if command == Command.CONNECT:
                self._client_port, body = struct.unpack("<HH", payload)[1], struct.pack("<BH", 0, 10)
            elif command == Command.GET_ROBOT_MODEL:
                body += FR3.urdf.encode()
            elif command == Command.MOVE:
                body = b"\1"
                self._state["robot_mode"], self._state["controller_mode"] = RobotMode.MOVE, Controller.EXTERNAL
                self._state["motion_generator_mode"] = 5
                self._state["errors"] = 0
            tcp.sendall(HEADER.pack(command, command_id, HEADER.size + len(body)) + body)


def test_the_smallest_state_that_it_accepts() -> None:
    short = Prop(STATE_BYTES - 1).hear()
    assert short.status == 1, f"{WANTS}it accepts a state of {STATE_BYTES - 1} bytes"
    assert "incorrect object size" in short.complaint
    whole = Prop(STATE_BYTES).hear()
    assert whole.status == 0, f"{WANTS}it refuses a state of {STATE_BYTES} bytes: {whole.complaint}"


def test_every_field_of_the_state_is_where_it_looks_for_it() -> None:
    heard, sent = Prop(STATE_BYTES).hear(), numbered_state()[0]
    assert heard.status == 0, f"{WANTS}{heard.complaint}"
    names = [name for name in ROBOT_STATE.names or () if name in heard.state]
    assert len(names) > 35
    moved = [name for name in names if not np.array_equal(np.ravel(heard.state[name]), np.ravel(sent[name]))]
    assert moved == [], WANTS + "these fields carry what another one should"
    for name, field in (("current_errors", "errors"), ("last_motion_errors", "reflex_reason")):
        expected = {error for error, raised in zip(ROBOT_ERRORS, sent[field], strict=True) if raised}
        assert set(heard.state[name]) == expected, f"{WANTS}{field}"
    assert heard.state["time"] > 1000


def test_the_command_that_it_sends() -> None:
    heard = Prop(STATE_BYTES).hear()
    assert len(heard.command) == COMMAND_BYTES, f"{WANTS}it sends commands of {len(heard.command)} bytes"
    command = np.frombuffer(heard.command, ROBOT_COMMAND)[0]
    assert command["tau_J_d"].tolist() == TORQUES, WANTS + "the torques are elsewhere"
    assert 1000 < command["message_id"] < 1_000_000
    assert not command["torque_command_finished"]
    assert not command["motion_generation_finished"]
