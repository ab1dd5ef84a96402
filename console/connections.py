"""Which connections stay when a program opens more of them than there is room for.

A connection is a stranger's until a request on it shows a session. Strangers make room for newer ones: of the address
that has most, the oldest first, long after its request was read, so that STOP has a way. Sessions' connections stay.
"""

import errno
import resource
import socket
import sys
import time
from collections import Counter
from contextlib import suppress
from typing import Any

_DESCRIPTORS = 65_536  # some systems allow a billion, and tables grow with it
_RESERVED = 256  # descriptors for files, children and scenes: a console at rest has 60, a page's scene takes two more
_CONNECTIONS = 2048
OF_ONE_SESSION = 48  # when it opens a WebSocket: a page has three or four
AT_ONCE = 8  # accepted in one turn of the event loop, which has signs of life to give: asyncio's backlog
_WAITING = 2048  # in the kernel, as uvicorn's own backlog
_SILENCE_S = 10  # then a silent client is accepted too, and the server's patience begins
_NO_ROOM = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_QUIET_S = 60.0  # between two lines on standard error

_visitors: "dict[int, Visitor]" = {}  # by their descriptors, the oldest first


def raise_descriptor_limit() -> None:
    """Allow this process as many descriptors as its hard limit does."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    soft = _DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, _DESCRIPTORS)
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def welcome(stream: Any, session: str) -> int:
    """Note that a connection has shown a session; return how many the session has. stream: its socket, or asyncio's."""
    visitor = _visitors.get(stream.fileno())
    if visitor is None:
        return 1
    door = visitor.door
    door.count[visitor.known] -= 1
    visitor.known, visitor.owner = True, session
    door.count[True] += 1
    return sum(other.owner == session for other in door.visitors(known=True))


class Visitor(socket.socket):
    """An accepted connection. owner: its address, or the session that it has shown."""

    door: "Door"
    owner: str
    known = False

    def forget(self) -> None:
        """Count it no more."""
        if _visitors.pop(self.fileno(), None) is not None:
            self.door.count[self.known] -= 1

    def close(self) -> None:
        """Close it, and make room."""
        self.forget()
        super().close()


class Door(socket.socket):
    """A listening socket that makes room for what it accepts. count: its connections, of strangers and of sessions."""

    def __init__(self, listener: socket.socket, strangers: int | None = None) -> None:
        """Take the place of a listener. strangers: the largest number; None: half of all connections."""
        super().__init__(listener.family, listener.type, listener.proto, fileno=listener.detach())
        self.setsockopt(socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, _SILENCE_S)
        limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        room = _CONNECTIONS if limit == resource.RLIM_INFINITY else min(_CONNECTIONS, limit - _RESERVED)
        self._most = max(room, 4 * AT_ONCE)
        self._strangers = self._most // 2 if strangers is None else strangers
        self.count = [0, 0]
        self._sent_away, self._said_s = 0, -_QUIET_S

    def listen(self, _backlog: int = AT_ONCE, /) -> None:
        """Listen, with room in the kernel for more than are accepted at once."""
        super().listen(_WAITING)

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept a client. Raises BlockingIOError where there is none, or no room for one."""
        try:
            taken, address = super().accept()
        except OSError as error:
            if error.errno not in _NO_ROOM:
                raise
            self._send_away()
            raise BlockingIOError from None  # the event loop asks again at once
        visitor = Visitor(taken.family, taken.type, taken.proto, fileno=taken.detach())
        visitor.door, visitor.owner = self, address[0]
        _visitors[visitor.fileno()] = visitor
        self.count[False] += 1
        if self.count[False] > self._strangers or sum(self.count) > self._most:
            self._send_away()
        return visitor, address

    def visitors(self, known: bool) -> list[Visitor]:
        """Return the connections of sessions, or those of strangers, the oldest first."""
        return [visitor for visitor in list(_visitors.values()) if visitor.door is self and visitor.known is known]

    def _send_away(self) -> None:
        """Disconnect some strangers, or else one session's connection: of the owners that have most, the oldest."""
        strangers = self.count[False] > AT_ONCE
        visitors = self.visitors(known=not strangers)
        sizes = Counter(visitor.owner for visitor in visitors)
        count = max(1, self._strangers // 16) if strangers else 1  # to look for them takes longer than to accept one
        for visitor in sorted(visitors, key=lambda visitor: -sizes[visitor.owner])[:count]:
            visitor.forget()
            with suppress(OSError):  # the client has gone already
                visitor.shutdown(socket.SHUT_RDWR)  # its transport then closes it
            self._sent_away += 1
            if time.monotonic() - self._said_s > _QUIET_S:
                self._said_s = time.monotonic()
                whose = "a session" if visitor.known else visitor.owner
                text = f"too many connections: {self._sent_away} closed for newer ones, the last from {whose}"
                print(f"console: {text}", file=sys.stderr, flush=True)
