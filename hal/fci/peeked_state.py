"""The oldest state that waits in libfranka's socket, looked at before libfranka reads it.

The kernel stamps each datagram on arrival (SO_TIMESTAMPNS, socket(7)). The first 8 bytes of a state are its number,
which is the robot's time in ms. Where no other one waits its values are taken from here, in one compiled call:
libfranka's lists take a third of the time from a state to its answer.

After a number that is ahead of the robot's time libfranka discards all true states until that time has come, with
Python's lock held. So a datagram that does not follow the last state is dropped before libfranka reads it.
"""

import contextlib
import os
import socket

import numpy as np
from numba import types

from hal.compilation import bound, compiled
from hal.host_work import MONOTONIC, REALTIME, now_ns
from hal.state import ArmState
from hal.wire import ROBOT_STATE

_BYTES = ROBOT_STATE.itemsize


@compiled
def unpack(datagrams, size, states, number):
    """Write datagrams[0], of so many bytes, to states[0], of ARM_STATE; return its robot mode; -1, and write nothing,
    for one that is not state `number`, of another layout, or of a robot with errors."""
    told = datagrams[0]
    if size != _BYTES or told.message_id != number:
        return -1
    for i in range(41):  # numbers one by one: slices take twice the time
        if told.errors[i] != 0:
            return -1
    state = states[0]
    state.t_ns = number * 1_000_000
    for i in range(7):
        state.q[i] = told.q[i]
        state.dq[i] = told.dq[i]
        state.tau_J[i] = told.tau_J[i]
        state.tau_J_d[i] = told.tau_J_d[i]
        state.dtau_J[i] = told.dtau_J[i]
        state.theta[i] = told.theta[i]
        state.dtheta[i] = told.dtheta[i]
        state.tau_ext_hat_filtered[i] = told.tau_ext_hat_filtered[i]
    for i in range(4):
        for j in range(4):
            state.O_T_EE[i, j] = told.O_T_EE[4 * j + i]
    for i in range(6):
        state.O_F_ext_hat_K[i] = told.O_F_ext_hat_K[i]
    state.control_command_success_rate = told.control_command_success_rate
    state.robot_mode = told.robot_mode
    state.current_errors = 0
    return int(told.robot_mode)


_SO_TIMESTAMPNS = 35  # asm-generic/socket.h
_STAMP = socket.SOL_SOCKET | _SO_TIMESTAMPNS << 32  # level and type of a control message (cmsg(3))
_PEEK, _TRUNC, _DONTWAIT = 0x02, 0x20, 0x40  # sys/socket.h
_CONTROL_BYTES = 64
_NANO = 1_000_000_000
# Indices of a look's words. The look: host's ns, robot's ms, host's ns, bytes. The state that was read last: robot's
# ms, host's ns. Then the count of dropped datagrams, and the number of the last one.
ARRIVED, OLDEST, LOOKED, SIZE, LAST, LAST_ARRIVED, DROPPED, STRANGE, WORDS = range(9)
AHEAD_MS = 100  # a number may be ahead of the host's time by what the network may hold back: hal.fci.pair.STALE_S
MOST_MS = 9_000_000_000_000  # its ns fit into 63 bits
JUMPED = -2
_MOST_DROPS = 64  # in one look

_recvmsg = types.ExternalFunction("recvmsg", types.int64(types.int32, types.intp, types.int32))


@compiled
def _follows(words, number, host_ns):
    """Return whether a state of this number may come next, at this time of the host."""
    if not 0 <= number < MOST_MS:
        return False
    ahead = number - words[LAST]
    return words[LAST] < 0 or 0 < ahead <= AHEAD_MS + (host_ns - words[LAST_ARRIVED]) // 1_000_000


@compiled
def _look(words, header, parts, control, datagram, clock, descriptor):
    """Return whether a state waits that follows the last one, and drop what comes before it."""
    header[2], header[3] = parts.ctypes.data, 1  # struct msghdr, recvmsg(2)
    parts[0], parts[1] = datagram.ctypes.data, _BYTES
    for _ in range(_MOST_DROPS):
        header[4], header[5] = control.ctypes.data, _CONTROL_BYTES
        control[1] = 0
        size = _recvmsg(np.int32(descriptor), header.ctypes.data, np.int32(_PEEK | _DONTWAIT | _TRUNC))
        now, words[LOOKED] = now_ns(REALTIME, clock), now_ns(MONOTONIC, clock)
        words[ARRIVED], words[OLDEST], words[SIZE] = words[LOOKED], -1, size
        if size < 0:
            return False
        if control[1] == _STAMP:
            words[ARRIVED] -= now - control[2] * _NANO - control[3]
        number = np.int64(datagram[0].message_id) if size >= 8 else -1
        if size == _BYTES and _follows(words, number, words[ARRIVED]):
            words[OLDEST] = number
            return True
        _recvmsg(np.int32(descriptor), header.ctypes.data, np.int32(_DONTWAIT))
        words[DROPPED] += 1
        words[STRANGE] = number
    words[SIZE] = -1
    return False


@compiled
def _state(words, datagram, state, clock, number):
    oldest, arrived = words[OLDEST], words[ARRIVED]
    mode = -1
    if number == oldest:
        mode = unpack(datagram, words[SIZE], state, number)
    elif not _follows(words, number, now_ns(MONOTONIC, clock)):
        words[STRANGE] = number
        return JUMPED
    words[LAST], words[LAST_ARRIVED] = number, arrived + (number - oldest) * 1_000_000 if oldest >= 0 else arrived
    return mode


class PeekedState:
    """The oldest state in an arm's socket: look, then take; neither waits or raises. words (WORDS,): of a look."""

    def __init__(self, state: ArmState | None = None) -> None:
        """state: of the arm, which `take` writes to."""
        self.words = np.zeros(WORDS, np.int64)
        self.words[LAST] = -1
        datagram, clock = np.zeros(1, ROBOT_STATE), np.zeros(2, np.int64)
        buffers = (np.zeros(7, np.int64), np.zeros(2, np.int64), np.zeros(8, np.int64), datagram)
        # look(descriptor): whether a state waits in a socket that follows the last one; what comes before it is dropped
        self.look = bound(_look, self.words, *buffers, clock, later=(0,))
        # take(number): that state was read; write it to the arm's, if it is the one that was looked at: see `unpack`.
        # JUMPED where the number cannot be the robot's: one that came between the look and the read
        self.take = bound(_state, self.words, datagram, (state or ArmState.empty()).record, clock, later=(0,))

    @property
    def strange(self) -> str:
        """What does not follow the last state, in words to follow why an arm is lost; "" for nothing."""
        last, dropped, number = (int(self.words[k]) for k in (LAST, DROPPED, STRANGE))
        if not dropped:
            return ""
        return f"; it sent {dropped} datagrams that do not follow state {last}, the last one with number {number}"


def stamp_arrivals(descriptor: int) -> None:
    """Have the kernel stamp what arrives at a socket; who reads it does not notice. Never raises."""
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(descriptor)) as sock:
        sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
