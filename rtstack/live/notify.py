"""What a service manager is told by sd_notify(3): that the process is ready, and the thread which matters alive."""

import os
import socket
import time
from contextlib import suppress

from rtstack.loop.watchdogs import Watchdog, WatchdogTrip

EVERY_S = 1.0  # the units' WatchdogSec is a minute


class Notifier:
    """Says READY=1 with the first sign of life, and WATCHDOG=1 with others, once in EVERY_S. Never waits or raises."""

    def __init__(self) -> None:
        name = os.environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + name[1:] if name.startswith("@") else name  # an abstract one
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) if name else None
        self._due_s: float | None = None

    def alive(self) -> None:
        """Pass on a sign of life."""
        now_s = time.monotonic()
        if self._socket is None or (self._due_s is not None and now_s < self._due_s):
            return
        with suppress(OSError):
            self._socket.sendto(b"READY=1" if self._due_s is None else b"WATCHDOG=1", self._address)
        self._due_s = now_s + EVERY_S

    def close(self) -> None:
        """Let go of the socket."""
        if self._socket is not None:
            self._socket.close()


class Pulse(Watchdog):
    """The loop's thread counts its turns, as a Watchdog that never trips; another one looks, and tells the manager."""

    def __init__(self, notifier: Notifier) -> None:
        self._notifier = notifier
        self._turns = self._seen = 0

    def beat(self) -> None:
        """Count a turn: one addition, for the loop's thread."""
        self._turns += 1

    def trip(self) -> WatchdogTrip | None:
        self._turns += 1
        return None

    def look(self) -> None:
        """Pass on a sign of life if the loop's thread has turned since the last look. For another thread."""
        if self._turns != self._seen:
            self._seen = self._turns
            self._notifier.alive()
