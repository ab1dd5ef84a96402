"""Which connections stay when a program opens more of them than there is room for.

A connection is a stranger's until a request on it shows a session. Strangers make room for newer ones: of the address
that has most, the oldest first. A request that has arrived is read long before its connection makes room, so that STOP
has a way. The connections of sessions stay. A client that sends nothing costs a descriptor and no more: asyncio accepts
its connection with its first byte.
"""

import asyncio
import errno
import resource
import select
import socket
import sys
import time
from contextlib import suppress
from typing import Any

_DESCRIPTORS = 65_536  # some systems allow a billion, and tables grow with it
_RESERVED = 256  # descriptors for files, children and scenes: a console at rest has 60, a page's scene takes two more
_CONNECTIONS = 2048
OF_ONE_SESSION = 48  # when it opens a WebSocket: a page has three or four
_AT_ONCE = 8  # accepted in one turn of the event loop, which has signs of life to give
_MANY = 64  # addresses
_NO_ROOM = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_SILENT_AT_ONCE = 64  # they take a tenth of the time
_SILENCE_S = 10.0  # a page speaks at once
_QUIET_S = 60.0  # between two lines on standard error

_Owner = tuple[bool, str]  # whether it has shown a session; the session, or its address
_visitors: "dict[int, Visitor]" = {}  # by their descriptors


def raise_descriptor_limit() -> None:
    """Allow this process as many descriptors as its hard limit does."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    soft = _DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, _DESCRIPTORS)
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def welcome(stream: Any, session: str) -> int:
    """Note that a connection has shown a session; return how many the session has. stream: its socket, or asyncio's."""
    visitor = _visitors.get(stream.fileno())
    return 1 if visitor is None else visitor.door.move(visitor, (True, session))


class Visitor(socket.socket):
    """An accepted connection."""

    door: "Door"
    owner: _Owner
    address: Any
    since_s: float

    def close(self) -> None:
        """Close it, and make room."""
        self.door.forget(self)
        _visitors.pop(self.fileno(), None)
        super().close()


class Door(socket.socket):
    """A listening socket for an asyncio server. It makes room for what it accepts."""

    def __init__(self, listener: socket.socket, strangers: int | None = None) -> None:
        """Take the place of a listener. strangers: the largest number; None: half of all connections."""
        super().__init__(listener.family, listener.type, listener.proto, fileno=listener.detach())
        limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        room = _CONNECTIONS if limit == resource.RLIM_INFINITY else min(_CONNECTIONS, limit - _RESERVED)
        self._most = max(room, 4 * _AT_ONCE)
        self._strangers = self._most // 2 if strangers is None else strangers
        self._groups: tuple[dict[str, dict[Visitor, None]], ...] = ({}, {})  # strangers, sessions; the oldest first
        self._count = [0, 0]
        self._silent: dict[int, Visitor] = {}  # by their descriptors, the oldest first
        self._ready = select.epoll()  # for the event loop: a client connects, or a silent one speaks
        self._ready.register(super().fileno(), select.EPOLLIN)
        self._turn = 0
        self._sent_away, self._said_s = 0, -_QUIET_S

    def fileno(self) -> int:
        """Return what the event loop waits for."""
        return -1 if self._ready.closed else self._ready.fileno()

    def close(self) -> None:
        """Accept nothing any more."""
        for visitor in [*self._silent.values()]:
            visitor.close()
        self._ready.close()
        super().close()

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept a client that speaks. Raises BlockingIOError where none does, or others have to be served first."""
        if self._turn == 0:
            asyncio.get_running_loop().call_soon(setattr, self, "_turn", 0)
        self._turn += 1
        for _ in range(_SILENT_AT_ONCE if self._turn <= _AT_ONCE else 0):
            for descriptor, _events in self._ready.poll(0, 2):
                if (speaks := self._silent.pop(descriptor, None)) is not None:
                    self._ready.unregister(descriptor)
                    return speaks, speaks.address
            visitor = self._take()
            with suppress(OSError):  # nothing yet; a client that has gone is found so later
                visitor.recv(1, socket.MSG_PEEK)
                return visitor, visitor.address
            if not self._silent:
                asyncio.get_running_loop().call_later(_SILENCE_S, self._end_silence)
            self._silent[visitor.fileno()] = visitor
            self._ready.register(visitor.fileno(), select.EPOLLIN)
        raise BlockingIOError

    def _take(self) -> Visitor:
        """Take a connection from the kernel. Raises BlockingIOError where there is none, or no room for one."""
        try:
            taken, address = super().accept()
        except OSError as error:
            if error.errno in _NO_ROOM:
                self._make_room(0)
                raise BlockingIOError from None  # the event loop asks again at once
            raise
        visitor = Visitor(taken.family, taken.type, taken.proto, fileno=taken.detach())
        visitor.setblocking(False)
        visitor.door, visitor.owner, visitor.address = self, (False, address[0]), address
        visitor.since_s = time.monotonic()
        _visitors[visitor.fileno()] = visitor
        self._add(visitor)
        self._make_room(self._most)
        return visitor

    def _end_silence(self) -> None:
        """Disconnect the clients that have been silent for long, and come again."""
        until_s = time.monotonic() - _SILENCE_S
        for visitor in [one for one in self._silent.values() if one.since_s <= until_s]:
            visitor.close()
        if self._silent:
            wait_s = next(iter(self._silent.values())).since_s - until_s
            asyncio.get_running_loop().call_later(wait_s, self._end_silence)

    def move(self, visitor: Visitor, owner: _Owner | None) -> int:
        """Count a connection among those of an owner, None where it ends. Returns how many the owner has."""
        known, name = visitor.owner
        group = self._groups[known].get(name, {})
        if visitor in group and visitor.owner != owner:
            del group[visitor]
            self._count[known] -= 1
            if not group:
                del self._groups[known][name]
            if owner is not None:
                visitor.owner = owner
                self._add(visitor)
        return 0 if owner is None else len(self._groups[owner[0]].get(owner[1], ()))

    def forget(self, visitor: Visitor) -> None:
        """Forget a connection that is closed."""
        self._silent.pop(visitor.fileno(), None)
        self.move(visitor, None)

    def _add(self, visitor: Visitor) -> None:
        known, name = visitor.owner
        self._groups[known].setdefault(name, {})[visitor] = None
        self._count[known] += 1

    def _make_room(self, most: int) -> None:
        """Disconnect one where there are more than `most`, or too many strangers: the oldest of the largest group."""
        if self._count[False] <= self._strangers and sum(self._count) <= most:
            return
        groups = self._groups[self._count[False] <= _AT_ONCE]
        if not groups:
            return
        # of many small groups the oldest: to look for the largest one would take longer than to accept
        oldest = next(iter(next(iter(groups.values())) if len(groups) > _MANY else max(groups.values(), key=len)))
        self.move(oldest, None)
        if oldest.fileno() in self._silent:
            oldest.close()
        with suppress(OSError):  # the client has gone already
            oldest.shutdown(socket.SHUT_RDWR)  # its transport then closes it
        self._sent_away += 1
        if time.monotonic() - self._said_s > _QUIET_S:
            self._said_s = time.monotonic()
            whose = "a session" if oldest.owner[0] else oldest.owner[1]
            text = f"too many connections: {self._sent_away} closed for newer ones, the last from {whose}"
            print(f"console: {text}", file=sys.stderr, flush=True)
