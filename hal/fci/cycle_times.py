"""When the kernel got a state, beside libfranka, which reads it: a look at the queue of its socket takes nothing out.

The kernel stamps each datagram on arrival (SO_TIMESTAMPNS, socket(7)). The first 8 bytes of a state are its number,
which is the robot's time in ms. A look at the oldest one tells how long states have waited here, whatever the loop did.
Where no other one waits it is the state that libfranka will read, and what it says is taken from here.
"""

import contextlib
import os
import socket
import time

import numpy as np
from numba import types

from hal.compilation import bound, compiled
from hal.cycle import CYCLE
from hal.fci.datagram import BYTES, DATAGRAM, unpack
from hal.state import ArmState

LATE_NS = 500_000  # from when the host's counters are read: half of what the robot allows
_TICK_NS = 1_000_000
_SO_TIMESTAMPNS = 35  # asm-generic/socket.h
_STAMP = socket.SOL_SOCKET | _SO_TIMESTAMPNS << 32  # level and type of a control message (cmsg(3))
_PEEK = 0x02 | 0x40  # MSG_PEEK, MSG_DONTWAIT, sys/socket.h
_REALTIME, _MONOTONIC = 0, 1  # time.h
_CONTROL_BYTES = 64
_NANO = 1_000_000_000
_ARRIVED, _OLDEST, _LOOKED, _LAST_T, _LAST_ARRIVED, _LATE, _SIZE = range(7)  # of the words

_recvmsg = types.ExternalFunction("recvmsg", types.int64(types.int32, types.intp, types.int32))
_clock_gettime = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.intp))


@compiled
def _look(words, header, parts, control, datagram, clock, descriptor):
    header[2], header[3] = parts.ctypes.data, 1  # struct msghdr, recvmsg(2)
    header[4], header[5] = control.ctypes.data, _CONTROL_BYTES
    parts[0], parts[1] = datagram.ctypes.data, BYTES
    control[1] = 0
    size = _recvmsg(np.int32(descriptor), header.ctypes.data, np.int32(_PEEK))
    _clock_gettime(np.int32(_REALTIME), clock.ctypes.data)
    now = clock[0] * _NANO + clock[1]
    _clock_gettime(np.int32(_MONOTONIC), clock.ctypes.data)
    words[_LOOKED] = clock[0] * _NANO + clock[1]
    words[_ARRIVED], words[_OLDEST], words[_SIZE] = words[_LOOKED], -1, size
    if size >= 8:
        words[_OLDEST] = datagram[0].message_id
        if control[1] == _STAMP:
            words[_ARRIVED] -= now - control[2] * _NANO - control[3]


@compiled
def _state(words, datagram, state, number):
    return unpack(datagram, words[_SIZE], state, number)


@compiled
def _answer(words, sample, clock, free_ns, read_ns, t_ns):
    _clock_gettime(np.int32(_MONOTONIC), clock.ctypes.data)
    arrived = words[_ARRIVED]
    answered = clock[0] * _NANO + clock[1] - arrived
    oldest = words[_OLDEST] * _TICK_NS if words[_OLDEST] >= 0 else t_ns
    cycle = sample[0]
    cycle.arrived_us = 1e-3 * arrived
    cycle.unread = max(1, (t_ns - oldest) // _TICK_NS + 1)
    cycle.free_us = 1e-3 * (free_ns - arrived)
    cycle.seen_us = 1e-3 * (words[_LOOKED] - arrived)
    cycle.read_us = 1e-3 * (read_ns - arrived)
    cycle.answered_us = 1e-3 * answered
    came_late = (arrived - words[_LAST_ARRIVED]) - (oldest - words[_LAST_T])
    late = answered > LATE_NS or cycle.unread > 1 or t_ns - words[_LAST_T] > _TICK_NS or came_late > LATE_NS
    words[_LATE] = 1 if late else 0
    words[_LAST_T], words[_LAST_ARRIVED] = t_ns, arrived + (t_ns - oldest)


class CycleTimes:
    """The cycles of one arm: a hal.cycle.Cycles. In the order look, read, answer; none of them waits or raises."""

    def __init__(self, state: ArmState | None = None) -> None:
        """state: of the arm, for `state`."""
        self.sample = np.zeros(1, CYCLE)
        self.free_ns = 0  # when the loop had ended its last cycle, of the monotonic clock
        self._read_ns = 0
        self._words = np.zeros(7, np.int64)
        clock = np.zeros(2, np.int64)
        datagram = np.zeros(1, DATAGRAM)
        buffers = (np.zeros(7, np.int64), np.zeros(2, np.int64), np.zeros(8, np.int64), datagram)
        # look(descriptor): at the oldest state that waits in a socket, before it is read
        self.look = bound(_look, self._words, *buffers, clock, later=(0,))
        # state(number): that state was read; write it to the arm's, if it is the one that was looked at: see `unpack`
        self.state = bound(_state, self._words, datagram, (state or ArmState.empty()).record, later=(0,))
        self._answer = bound(_answer, self._words, self.sample, clock, later=(0, 0, 0))

    def read(self) -> None:
        """Note that the newest state was read."""
        self._read_ns = time.monotonic_ns()

    def answer(self, t_ns: int) -> None:
        """Note that the state of this robot's time was answered: now `sample` and `late` are of this cycle."""
        self._answer(self.free_ns, self._read_ns, t_ns)

    @property
    def late(self) -> bool:
        """See hal.cycle.Cycles."""
        return bool(self._words[_LATE])


def stamp_arrivals(descriptor: int) -> None:
    """Have the kernel stamp what arrives at a socket; who reads it does not notice. Never raises."""
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(descriptor)) as sock:
        sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
