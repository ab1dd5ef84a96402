"""Ends a call to libfranka that lasts too long.

libfranka waits without an end for answers, and for a state that follows the last one, and pylibfranka keeps Python's
lock meanwhile. So a compiled thread, which needs no lock, shuts down the sockets to the box: libfranka then raises.
"""

import socket
import sys
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
CALL, _POLLS, FIRED, _END = range(4)

_poll = types.ExternalFunction("poll", types.int32(types.intp, types.uint64, types.int32))
_shutdown = types.ExternalFunction("shutdown", types.int32(types.int32, types.int32))
_getpeername = types.ExternalFunction("getpeername", types.int32(types.int32, types.intp, types.intp))


@compiled(nogil=True)
def _watch(words, address, size, host):
    """address: a struct sockaddr_in as (4,) uint32; its second one is the host."""
    call, polls = 0, 0
    while words[_END] == 0:
        _poll(address.ctypes.data, np.uint64(0), np.int32(_POLL_MS))
        polls = polls + 1 if words[CALL] == call else 0
        call = words[CALL]
        if call == 0 or polls < words[_POLLS]:
            continue
        words[FIRED] = 1
        for k in range(_MOST_DESCRIPTORS):
            size[0], descriptor = 16, np.int32(k)
            failed = _getpeername(descriptor, address.ctypes.data, size.ctypes.data)
            if failed == 0 and address[0] & 0xFFFF == _INET and address[1] == host:
                _shutdown(descriptor, np.int32(_SHUT_RDWR))


class CallLimit:
    """The thread that ends the calls to one box. words[CALL]: set it before each read, 0 after it; words[FIRED]: 1 once
    a call was ended."""

    def __init__(self, host: str) -> None:
        """host: numeric address of the box, "" for none."""
        words = np.array([0, round(1e3 * READ_S / _POLL_MS), 0, 0], np.int64)
        self.words = words.data
        number = int.from_bytes(socket.inet_aton(host or "0.0.0.0"), sys.byteorder)
        self._watch = bound(_watch, words, np.zeros(4, np.uint32), np.zeros(1, np.uint32), number)
        threading.Thread(target=self._run, daemon=True, name="limit of calls").start()

    def _run(self) -> None:
        beside_realtime()
        self._watch()

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
        self.words[_END] = 1
