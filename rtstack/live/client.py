"""A program's side of the robot process: what the console uses, and any other program may."""

import os
import socket
import stat
import struct
import tempfile
import threading
from contextlib import closing
from pathlib import Path

from hal.base.shared import user_name
from rtstack.live import protocol
from rtstack.trials.errors import TrialError

RUN_PREFIX = "rtstack-"  # of the folder of a running stack, among the temporary files
SOCKET_NAME = "robot.sock"
_STOP_S = 2.0  # for the answer to a STOP
ANSWER_S = 32.0  # the longest answer, that to a recovery, and a margin
SERVICE_SOCKET = Path("/run/rtstack") / SOCKET_NAME  # of the unit rtstack-robot.service


def running_stacks() -> list[Path]:
    """Return the sockets of this user's robot processes that listen."""
    found = [*sorted(Path(tempfile.gettempdir()).glob(f"{RUN_PREFIX}*/{SOCKET_NAME}")), SERVICE_SOCKET]
    return [path for path in found if _ours(path) and listens(path)]


def only_stack(naming: str) -> Path:
    """Return the one running stack's socket. naming: how a user names one. Raises TrialError for none or several."""
    found = running_stacks()
    if not found:
        todo = "start one with `rtstack up`, or name the arms with --cell fci:LEFT,RIGHT"
        raise TrialError(f"no stack is running: {todo}")
    if len(found) > 1:
        raise TrialError(f"{len(found)} stacks are running: name one with {naming}: {', '.join(map(str, found))}")
    return found[0]


def _ours(path: Path) -> bool:
    try:
        status = path.lstat()
    except OSError:
        return False
    return stat.S_ISSOCK(status.st_mode) and status.st_uid == os.getuid()


def listens(path: Path) -> bool:
    """Whether a robot process listens at a socket."""
    try:
        _connected(path, ANSWER_S).close()
    except OSError:
        return False
    return True


def peer_uid(connection: socket.socket) -> int:
    """Return the user of the process at the other end of a Unix socket, as the kernel has noted it (unix(7))."""
    _, uid, _ = struct.unpack("3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i")))
    return uid


def _connected(path: Path, timeout_s: float) -> socket.socket:
    """Connect to a robot process of this user, or as root to any. Raises OSError."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        connection.settimeout(timeout_s)
        connection.connect(str(path))
        if os.geteuid() not in (0, uid := peer_uid(connection)):
            raise PermissionError(f"{user_name(uid)} listens at {path}")
    except OSError:
        connection.close()
        raise
    return connection


class RobotUnreachable(Exception):
    """The robot process does not answer. The message says what was tried."""


class RobotRefused(Exception):
    """The robot process answered no. The message is its reason, one line."""


class RobotClient:
    """Speaks with the robot process at a socket. Connects when needed; may be shared by threads."""

    def __init__(self, path: Path, timeout_s: float = ANSWER_S) -> None:
        self._path, self._timeout_s = path, timeout_s
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None

    def status(self) -> protocol.Status:
        """Return how the robot process is. Raises RobotUnreachable."""
        return self.request(protocol.StatusRequest())

    def start(self, run: protocol.RunRequest) -> protocol.Status:
        """Ask for a run. Raises RobotRefused with the reason, RobotUnreachable."""
        return self.request(run)

    def take(self, operator: str, over_from: str | None = None) -> protocol.Status:
        """Take the lease. Raises RobotRefused, which names who has it, RobotUnreachable."""
        return self.request(protocol.TakeRequest(operator, over_from))

    def release(self, operator: str) -> protocol.Status:
        """Give the lease back. Raises RobotRefused, RobotUnreachable."""
        return self.request(protocol.ControlRequest(operator, "release"))

    def beat(self, operator: str) -> protocol.Status:
        """Give a sign of life; the status says who has the lease. Raises RobotUnreachable."""
        return self.request(protocol.ControlRequest(operator, "beat"))

    def arm(self, operator: str) -> protocol.Status:
        """Allow motion. Raises RobotRefused, RobotUnreachable."""
        return self.request(protocol.ControlRequest(operator, "arm"))

    def disarm(self, operator: str) -> protocol.Status:
        """Allow no motion any more. Raises RobotUnreachable."""
        return self.request(protocol.ControlRequest(operator, "disarm"))

    def stop(self, operator: str) -> protocol.Status:
        """Ask for a controlled stop by the socket, beside other requests. Raises RobotRefused, RobotUnreachable."""
        with closing(RobotClient(self._path, _STOP_S)) as beside:
            return beside.request(protocol.ControlRequest(operator, "stop"))

    def recover(self, operator: str) -> protocol.Status:
        """Ask for a recovery and wait for it. Raises RobotRefused while the cause persists, RobotUnreachable."""
        return self.request(protocol.ControlRequest(operator, "recover"))

    def request(self, request: protocol.Request) -> protocol.Status:
        """Send a request and return the status that answers it. Raises RobotRefused, RobotUnreachable."""
        with self._lock:
            try:
                try:
                    line = self._exchange(protocol.encode(request))
                except ConnectionError:
                    if self._socket is None:
                        raise
                    self._drop()  # it was idle, and made room for another one's
                    line = self._exchange(protocol.encode(request))
                answer = protocol.decode_answer(line)
            except (OSError, protocol.ProtocolError) as error:
                self._drop()
                raise RobotUnreachable(f"the robot process does not answer: {error}") from None
        if answer.error is not None:
            raise RobotRefused(answer.error)
        if answer.status is None:
            raise RobotUnreachable("the robot process sent an empty answer")
        return answer.status

    def close(self) -> None:
        """Let go of the connection."""
        with self._lock:
            self._drop()

    def _exchange(self, line: bytes) -> bytes:
        if self._socket is None:
            self._socket = _connected(self._path, self._timeout_s)
        self._socket.sendall(line)
        received = bytearray()
        while not received.endswith(b"\n"):
            part = self._socket.recv(65536)
            if not part:
                raise ConnectionError("it closed the connection")
            received += part
            if len(received) > protocol.MAX_LINE_BYTES:
                raise ConnectionError("its answer is too long")
        return bytes(received)

    def _drop(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None
