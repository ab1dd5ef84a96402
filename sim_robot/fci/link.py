"""One arm's sockets: whole checked requests in, answers and states out. Never blocks. One client has the arm."""

import contextlib
import socket
import struct
import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from hal.wire import HEADER, PORT, ROBOT_COMMAND, VERSION
from sim_robot.fci.poller import Poller
from sim_robot.fci.port import Port, Session
from sim_robot.fci.protocol import PAYLOADS, Command, ConnectStatus
from sim_robot.profile import LATE_SHARES

MOST_SESSIONS = 8  # connections that have not said Connect yet, and the client
_SO_TIMESTAMPNS = 35  # asm-generic/socket.h: each datagram carries when the kernel got it, a timespec
_TIMESPEC = struct.Struct("qq")
_ANCILLARY_BYTES = socket.CMSG_SPACE(_TIMESPEC.size)
MOST_DATAGRAMS = 32  # read at a time, so that a flood cannot hold the loop


class Link(Port):
    """The network side of one arm. `on_request` gets whole requests, `on_command` the datagrams of the client."""

    header, payloads, most = HEADER, PAYLOADS, MOST_SESSIONS

    def __init__(
        self, poller: Poller, address: str, on_request: Callable[[Command, int, tuple], None],
        on_command: Callable[[np.void], None], on_gone: Callable[[], None],
    ) -> None:  # fmt: skip
        """Listen at `address`, port 1337. Raises OSError, for example when the port is taken."""
        self._on_request, self._on_command, self._on_gone = on_request, on_command, on_gone
        self.client: Session | None = None
        self._udp: socket.socket | None = None
        self._command = np.zeros(1, ROBOT_COMMAND)
        self._command_bytes = self._command.view(np.uint8).data
        self._overlong = bytearray(ROBOT_COMMAND.itemsize + 1)  # one more byte shows a datagram that is too long
        self._buffers = (self._overlong,)
        self.arrived_ns = 0  # when the command that `on_command` gets came in, by the kernel's word, ns of time.time_ns
        self._late_us: Sequence[float] = ()
        self._draws, self._last_s = np.random.default_rng(0), 0.0
        super().__init__(poller, address, PORT)

    # connections

    def _set_up(self, tcp: socket.socket) -> None:
        tcp.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # a client whose end the cable has swallowed makes room for the next one within some seconds
        tcp.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, seconds_or_times in ((socket.TCP_KEEPIDLE, 1), (socket.TCP_KEEPINTVL, 1), (socket.TCP_KEEPCNT, 3)):
            tcp.setsockopt(socket.IPPROTO_TCP, option, seconds_or_times)

    def _is_client(self, session: Session) -> bool:
        return session is self.client

    def _gone(self, session: Session) -> None:
        if session is self.client:
            self.client = None
            if self._udp is not None:
                self._poller.forget(self._udp)
                self._udp.close()
                self._udp = None
            self._on_gone()

    # requests

    def _dispatch(self, session: Session, command: int, command_id: int, values: tuple) -> None:
        if command == Command.CONNECT:
            self._connect(session, command_id, *values)
        elif session is self.client:
            self._on_request(Command(command), command_id, values)
        else:
            self._distrust(session)

    def _connect(self, session: Session, command_id: int, version: int, udp_port: int) -> None:
        for _ in range(2):  # the client's last words, and that it has hung up, may have come together with this
            if self.client not in (None, session):
                self._serve(self.client)
        if self.client is not None or udp_port == 0:
            # libfranka waits for ever for an answer, even on a closed connection; this one it reports as an error
            self.refused += 1
            self._answer(session, Command.CONNECT, command_id, bytes((ConnectStatus.TAKEN, 0, 0)))
            return
        body = bytes((ConnectStatus.SUCCESS,)) + VERSION.to_bytes(2, "little")
        if version != VERSION:
            body = bytes((ConnectStatus.INCOMPATIBLE_VERSION,)) + VERSION.to_bytes(2, "little")
            self._answer(session, Command.CONNECT, command_id, body)
            return
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._udp.setblocking(False)
        self._udp.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._udp.bind((self.address, 0))
        try:
            self._udp.connect((session.address, udp_port))  # the kernel drops what others send
        except OSError:
            self._udp.close()
            self._udp = None
            self._distrust(session)
            return
        self._poller.watch(self._udp, self._receive_commands)
        self.client = session
        self._answer(session, Command.CONNECT, command_id, body)

    def reply(self, command: Command, command_id: int, body: bytes) -> None:
        if self.client is not None:
            self._answer(self.client, command, command_id, body)

    # states and commands

    def be_late(self, late_us: Sequence[float], seed: Sequence[int]) -> None:
        """Send each state from now on as late as is drawn: quantiles at LATE_SHARES, us. None overtakes another."""
        self._late_us, self._draws = late_us, np.random.default_rng(np.random.SeedSequence(seed))

    def send_state(self, state: memoryview) -> None:
        """Send one state to the client, if there is one. A datagram that does not fit is lost, as on a network."""
        if not self._late_us:
            self._send_state(state)
            return
        late_us = float(np.interp(self._draws.random(), (0.0, *LATE_SHARES), (0.0, *self._late_us)))
        self._last_s = max(self._last_s, time.monotonic() + 1e-6 * late_us)
        self._poller.at(self._last_s, partial(self._send_state, bytes(state)))

    def _send_state(self, state: memoryview | bytes) -> None:
        if self._udp is not None:
            with contextlib.suppress(OSError):
                self._udp.send(state)

    def _receive_commands(self) -> None:
        for _ in range(MOST_DATAGRAMS):
            if self._udp is None:
                return
            try:
                size, ancillary, _, _ = self._udp.recvmsg_into(self._buffers, _ANCILLARY_BYTES)
            except BlockingIOError:
                return
            except OSError:  # the client's port is closed: its TCP connection tells
                continue
            if size != ROBOT_COMMAND.itemsize:
                self.refused += 1
                continue
            self._command_bytes[:] = self._overlong[:size]
            if ancillary:
                seconds, nanoseconds = _TIMESPEC.unpack(ancillary[0][2])
                self.arrived_ns = seconds * 1_000_000_000 + nanoseconds
            self._on_command(self._command[0])

    def close(self) -> None:
        """Close every socket."""
        self.listen(False)
