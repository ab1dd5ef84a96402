"""A TCP port of a box: who is connected, and requests of known commands and sizes. Never blocks."""

import socket
import struct
from collections.abc import Mapping
from typing import Any, ClassVar

from sim_robot.fci.poller import Poller

BACKLOG = 128  # connections that wait in the kernel to be taken
LARGEST_OUTBOX = 1 << 20  # a client that asks and never reads
ACCEPT_PERIOD_S = 0.5e-3  # one connection at a time, so that a flood costs the loop two a millisecond


class Session:
    """One TCP connection and what it has not sent or read yet."""

    def __init__(self, tcp: socket.socket, address: str) -> None:
        self.tcp, self.address = tcp, address
        self.inbox, self.outbox = bytearray(), bytearray()


class Port:
    """A listener and its sessions. header: command, id, size with it; payloads: by command; most: sessions at once."""

    header: ClassVar[struct.Struct]
    payloads: ClassVar[Mapping[Any, struct.Struct]]
    most: ClassVar[int]

    def __init__(self, poller: Poller, address: str, port: int) -> None:
        self._poller, self.address, self._port = poller, address, port
        self.refused = 0  # connections and messages that were not trusted
        self._sessions: list[Session] = []
        self._listener: socket.socket | None = None
        self.listen(True)

    def listen(self, wanted: bool) -> None:
        """Take connections, or refuse each one, and hang up on all that there are. Raises OSError."""
        if wanted and self._listener is None:
            self._listener = socket.create_server((self.address, self._port), backlog=BACKLOG)
            self._listener.setblocking(False)
            self._poller.watch(self._listener, self._accept)
        elif not wanted and self._listener is not None:
            for session in tuple(self._sessions):
                self._close(session)
            self._poller.forget(self._listener)
            self._listener.close()
            self._listener = None

    def _accept(self) -> None:
        assert self._listener is not None
        self._poller.rest(self._listener, ACCEPT_PERIOD_S)
        try:
            tcp, (address, _) = self._listener.accept()
        except OSError:
            return
        self._set_up(tcp)
        if len(self._sessions) >= self.most:
            # who has been silent for longest, if any: a client says Connect at once
            silent = next((session for session in self._sessions if not self._is_client(session)), None)
            if silent is None:
                tcp.close()
                return
            self._distrust(silent)
        tcp.setblocking(False)
        session = Session(tcp, address)
        self._sessions.append(session)
        self._poller.watch(tcp, lambda: self._serve(session))

    def _close(self, session: Session) -> None:
        if session in self._sessions:
            self._sessions.remove(session)
            self._poller.forget(session.tcp)
            session.tcp.close()
            self._gone(session)

    def _distrust(self, session: Session) -> None:
        self.refused += 1
        self._close(session)

    def _serve(self, session: Session) -> None:
        if session.outbox:
            self._flush(session)
        try:
            chunk = session.tcp.recv(4096)
        except BlockingIOError:
            return
        except OSError:
            chunk = b""
        if not chunk:
            self._close(session)
            return
        inbox, header = session.inbox, self.header
        inbox += chunk
        while session in self._sessions and len(inbox) >= header.size:
            command, command_id, size = header.unpack_from(inbox)
            if command not in self.payloads or size != header.size + self.payloads[command].size:
                self._distrust(session)
                return
            if len(inbox) < size:
                return
            values = self.payloads[command].unpack_from(inbox, header.size)
            del inbox[:size]
            self._dispatch(session, command, command_id, values)

    def _answer(self, session: Session, command: int, command_id: int, body: bytes) -> None:
        session.outbox += self.header.pack(command, command_id, self.header.size + len(body)) + body
        if len(session.outbox) > LARGEST_OUTBOX:
            self._distrust(session)
        else:
            self._flush(session)

    def _flush(self, session: Session) -> None:
        try:
            del session.outbox[: session.tcp.send(session.outbox)]
        except BlockingIOError:
            pass
        except OSError:
            self._close(session)
            return
        self._poller.want_write(session.tcp, bool(session.outbox))

    def _set_up(self, tcp: socket.socket) -> None:
        """Set the options of a new connection."""

    def _is_client(self, session: Session) -> bool:
        """Whether a session has said Connect, and was taken."""
        raise NotImplementedError

    def _gone(self, session: Session) -> None:
        """Forget a session that has ended."""

    def _dispatch(self, session: Session, command: int, command_id: int, values: tuple) -> None:
        """Carry out a request."""
        raise NotImplementedError
