"""Ends a call to libfranka that lasts too long.

libfranka waits without an end for answers to its requests, and for a state that follows the last one while others come.
pylibfranka keeps Python's lock meanwhile: no signal, no other thread gets through. So a compiled thread, which needs no
lock, shuts down the sockets that lead to the box then, and libfranka raises an exception.
"""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numba import types

from hal.base.realtime import beside_realtime
from hal.compilation import bound, compiled

CALL_S = 5.0  # a box answers at once; one that is slow to start or to stop takes some 0.1 s
READ_S = 1.2  # libfranka itself gives up after 1 s in which nothing comes
_POLL_MS = 20
_MOST_DESCRIPTORS = 4096
_INET, _SHUT_RDWR = 2, 2  # sys/socket.h
# the call that lasts, by a number of its own, 0 for none; after how many polls it is ended; whether one was; the end
CALL, _POLLS, _FIRED, _END = range(4)

_poll = types.ExternalFunction("poll", types.int32(types.intp, types.uint64, types.int32))
_shutdown = types.ExternalFunction("shutdown", types.int32(types.int32, types.int32))
_getpeername = types.ExternalFunction("getpeername", types.int32(types.int32, types.intp, types.intp))


@compiled
def _leads_to(descriptor, host, address, size):
    """Return whether a socket leads to a host, (4,) bytes."""
    size[0] = address.size
    if _getpeername(np.int32(descriptor), address.ctypes.data, size.ctypes.data) != 0 or address[0] != _INET:
        return False
    a = address[4:8]  # of struct sockaddr_in
    return a[0] == host[0] and a[1] == host[1] and a[2] == host[2] and a[3] == host[3]


@compiled(nogil=True)
def _watch(words, host, address, size):
    call, polls = 0, 0
    while words[_END] == 0:
        _poll(address.ctypes.data, np.uint64(0), np.int32(_POLL_MS))
        polls = polls + 1 if words[CALL] == call else 0
        call = words[CALL]
        if call == 0 or polls < words[_POLLS]:
            continue
        words[_FIRED] = 1
        for descriptor in range(_MOST_DESCRIPTORS):
            if _leads_to(descriptor, host, address, size):
                _shutdown(np.int32(descriptor), np.int32(_SHUT_RDWR))


class CallLimit:
    """The thread that ends the calls to one box. words[CALL]: set it before each read, 0 after it."""

    def __init__(self, host: str) -> None:
        """host: numeric address of the box, "" for none."""
        words = np.array([0, round(1e3 * READ_S / _POLL_MS), 0, 0], np.int64)
        self.words = words.data
        address = np.frombuffer(socket.inet_aton(host or "0.0.0.0"), np.uint8).copy()
        self._watch = bound(_watch, words, address, np.zeros(16, np.uint8), np.zeros(1, np.uint32))
        threading.Thread(target=self._run, daemon=True, name="limit of calls").start()

    def _run(self) -> None:
        beside_realtime()
        self._watch()

    @property
    def fired(self) -> bool:
        """Whether a call was ended since the last connection."""
        return bool(self.words[_FIRED])

    def forget(self) -> None:
        """Begin anew, with a new connection."""
        self.words[_FIRED] = 0

    @contextmanager
    def within(self) -> Iterator[None]:
        """Return the context of a call outside of the loop, which may last for CALL_S."""
        reads, self.words[_POLLS] = self.words[_POLLS], round(1e3 * CALL_S / _POLL_MS)
        self.words[CALL] = time.monotonic_ns()
        try:
            yield
        finally:
            self.words[CALL], self.words[_POLLS] = 0, reads

    def close(self) -> None:
        """End the thread."""
        self.words[_END] = 1
