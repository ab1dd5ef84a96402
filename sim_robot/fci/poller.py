"""Waiting for sockets with a resolution of microseconds, and never longer than asked."""

import select
import socket
import time
from collections.abc import Callable

_READ = select.EPOLLIN | select.EPOLLHUP | select.EPOLLERR


class Poller:
    """Calls whom a socket belongs to when it is ready. Datagrams come before streams: they are the answers."""

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._callbacks: dict[int, tuple[bool, Callable[[], None]]] = {}
        self._wait_list = [self._epoll]
        self._resting: dict[int, float] = {}  # descriptor: until when it is not looked at
        self._timers: list[tuple[float, Callable[[], None]]] = []

    def watch(self, sock: socket.socket, callback: Callable[[], None]) -> None:
        """Call `callback` whenever `sock` can be read, or written while `want_write` is set."""
        self._callbacks[sock.fileno()] = (sock.type == socket.SOCK_DGRAM, callback)
        self._epoll.register(sock.fileno(), _READ)

    def want_write(self, sock: socket.socket, wanted: bool) -> None:
        """Report also when `sock` can be written."""
        self._epoll.modify(sock.fileno(), _READ | (select.EPOLLOUT if wanted else 0))

    def rest(self, sock: socket.socket, seconds: float) -> None:
        """Do not look at `sock` for a while: what comes waits in the kernel."""
        self._epoll.modify(sock.fileno(), 0)
        self._resting[sock.fileno()] = time.monotonic() + seconds

    def at(self, when_s: float, callback: Callable[[], None]) -> None:
        """Call `callback` once, at `when_s` of time.monotonic or as soon afterwards as `serve` is called."""
        self._timers.append((when_s, callback))

    def _wake(self) -> float:
        """Look again at what has rested long enough, and call what is due; return for how long the next one waits."""
        now = time.monotonic()
        due = [callback for when_s, callback in self._timers if when_s <= now]
        self._timers = [each for each in self._timers if each[0] > now]
        for callback in due:
            callback()
        for descriptor, until_s in tuple(self._resting.items()):
            if until_s <= now:
                del self._resting[descriptor]
                self._epoll.modify(descriptor, _READ)
        return min((*self._resting.values(), *(when_s for when_s, _ in self._timers)), default=now) - now

    def forget(self, sock: socket.socket) -> None:
        """Stop watching; call it before closing the socket."""
        self._resting.pop(sock.fileno(), None)
        if self._callbacks.pop(sock.fileno(), None) is not None:
            self._epoll.unregister(sock.fileno())

    def serve(self, timeout_s: float) -> bool:
        """Wait up to `timeout_s`, call each ready one once, and return whether there was any."""
        if self._resting or self._timers:
            rest_s = self._wake()
            timeout_s = min(timeout_s, rest_s) if self._resting or self._timers else timeout_s
        # epoll alone rounds to milliseconds; select on the epoll's own descriptor does not
        if timeout_s > 0.0 and not select.select(self._wait_list, (), (), timeout_s)[0]:
            return False
        ready = self._epoll.poll(0)
        if not ready:
            return False
        if len(ready) > 1:
            ready.sort(key=self._order)
        for descriptor, _ in ready:
            entry = self._callbacks.get(descriptor)  # an earlier callback may have closed it
            if entry is not None:
                entry[1]()
        return True

    def _order(self, event: tuple[int, int]) -> tuple[bool, int]:
        entry = self._callbacks.get(event[0])
        return (entry is None or not entry[0], event[0])

    def close(self) -> None:
        self._epoll.close()
