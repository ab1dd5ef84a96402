"""A client that speaks the bytes itself, to send what no library would send."""

import select
import socket
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from hal.robot_errors import ROBOT_ERRORS
from hal.state import RobotMode
from hal.wire import HEADER, PORT, ROBOT_COMMAND, ROBOT_STATE, VERSION
from sim_robot.fci.protocol import Command, MoveStatus

Deviation = tuple[float, float, float]  # translation m, rotation rad, elbow rad
ANYWHERE = (10.0, 3.12, 6.29)  # what a client says that does not care; libfranka: 2 pi for the elbow


def errors_of(state: np.void, field: str = "errors") -> set[str]:
    """Names of the errors, or of the reflex's reasons, that a state shows."""
    return {name for name, raised in zip(ROBOT_ERRORS, state[field], strict=True) if raised}


class RawClient:
    """One TCP connection and one UDP socket. No receive waits for more than a minute."""

    def __init__(self, address: str) -> None:
        self.tcp = socket.create_connection((address, PORT), timeout=60.0)
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.settimeout(60.0)
        self.udp.bind(("", 0))
        self._source: tuple[str, int] = ("", 0)
        self._next_id = 0

    def send(self, command: int, payload: bytes = b"", size: int | None = None) -> int:
        """Send a request, with a size that may lie; return its id."""
        self._next_id += 1
        length = HEADER.size + len(payload) if size is None else size
        self.tcp.sendall(HEADER.pack(command, self._next_id, length) + payload)
        return self._next_id

    def _receive(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            chunk = self.tcp.recv(size - len(data))
            if not chunk:
                raise ConnectionResetError("the server closed the connection")
            data += chunk
        return data

    def answer(self) -> tuple[int, int, bytes]:
        """Return the next answer: command, id, body. Raises ConnectionResetError when the server hung up."""
        command, command_id, size = HEADER.unpack(self._receive(HEADER.size))
        return command, command_id, self._receive(size - HEADER.size)

    def connect(self, version: int = VERSION) -> bytes:
        """Say Connect and return the body of the answer."""
        self.send(Command.CONNECT, struct.pack("<HH", version, self.udp.getsockname()[1]))
        return self.answer()[2]

    def move(
        self, controller: int = 2, generator: int = 4, path: Deviation = ANYWHERE, goal: Deviation = ANYWHERE
    ) -> int:
        """Ask for a motion, off by at most path and goal, and return the status of the first answer."""
        payload = struct.pack("<II3d3dB7d", controller, generator, *path, *goal, 0, *(0.0,) * 7)
        self.send(Command.MOVE, payload)
        return self.answer()[2][0]

    def state(self) -> np.void:
        """Return the newest state, or wait for the next one."""
        data, self._source = self.udp.recvfrom(4096)
        self.udp.setblocking(False)
        try:
            while True:
                data, self._source = self.udp.recvfrom(4096)
        except BlockingIOError:
            pass
        finally:
            self.udp.settimeout(60.0)
        return np.frombuffer(data, ROBOT_STATE)[0]

    def moving_state(self) -> np.void:
        """Return the first state that shows the motion: earlier ones were sent before the robot took the request."""
        while (state := self.state())["robot_mode"] != RobotMode.MOVE:
            continue
        return state

    def begin(self, controller: int = 2, generator: int = 4, **deviations: Deviation) -> np.void:
        """Connect, begin a motion, and return the first state that shows it."""
        self.connect()
        assert self.move(controller, generator, **deviations) == MoveStatus.MOTION_STARTED
        return self.moving_state()

    def next_state(self) -> np.void:
        """Return the oldest state that was not read, or wait for the next one."""
        data, self._source = self.udp.recvfrom(4096)
        return np.frombuffer(data, ROBOT_STATE)[0]

    def command(self, state: np.void, **fields: object) -> None:
        """Answer `state` with the given fields of ROBOT_COMMAND."""
        record = np.zeros(1, ROBOT_COMMAND)
        record["message_id"] = state["message_id"]
        for name, value in fields.items():
            record[name] = value
        self.udp.sendto(record.tobytes(), self._source)

    def throw(self, data: bytes) -> None:
        """Send any datagram to where the states come from."""
        self.udp.sendto(data, self._source)

    def lost_on_the_way(self) -> int:
        """How many datagrams the kernel has dropped at the server's socket, which was full."""
        host, port = self._source
        local = f"{int.from_bytes(socket.inet_aton(host), 'little'):08X}:{port:04X}"
        lines = Path("/proc/net/udp").read_text().splitlines()
        return sum(int(line.split()[-1]) for line in lines if line.split()[1] == local)

    def close(self) -> None:
        """Hang up."""
        self.tcp.close()
        self.udp.close()

    def __enter__(self) -> "RawClient":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def arriving(raws: Sequence[RawClient], newest: bool = False) -> Iterator[tuple[int, np.void]]:
    """Yield (index, state) as states of several clients arrive, for ever: nobody waits for another one's.

    newest: without those that have waited, as a client has to answer that keeps up with a clock.
    """
    while True:
        ready, _, _ = select.select([raw.udp for raw in raws], (), (), 5.0)
        assert ready, "no state of any arm"
        for index, raw in enumerate(raws):
            if raw.udp in ready:
                yield index, raw.state() if newest else raw.next_state()
