"""The oldest state that waits in libfranka's socket, looked at before libfranka reads it: nothing is taken out.

The kernel stamps each datagram on arrival (SO_TIMESTAMPNS, socket(7)). The first 8 bytes of a state are its number,
which is the robot's time in ms. Where no other one waits it is the state that libfranka will read, and its values are
taken from here, in one compiled call: libfranka gives them as lists of Python's, which takes a third of the time from a
state to its answer.
"""

import contextlib
import os
import socket

import numpy as np
from numba import types

from hal.compilation import bound, compiled
from hal.state import ArmState
from hal.wire import ROBOT_STATE

_BYTES = ROBOT_STATE.itemsize


@compiled
def unpack(datagrams, size, states, number):
    """Write datagrams[0], of so many bytes, to states[0], of ARM_STATE; return its robot mode.

    -1, and nothing is written, for one that is not state `number`, of another layout, or of a robot with errors.
    """
    told = datagrams[0]
    if size != _BYTES or told.message_id != number:
        return -1
    for i in range(41):
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
_PEEK = 0x02 | 0x40  # MSG_PEEK, MSG_DONTWAIT, sys/socket.h
_REALTIME, _MONOTONIC = 0, 1  # time.h
_CONTROL_BYTES = 64
_NANO = 1_000_000_000
ARRIVED, OLDEST, LOOKED, SIZE, WORDS = range(5)  # of the words of a look: host's ns, robot's ms, host's ns, bytes

_recvmsg = types.ExternalFunction("recvmsg", types.int64(types.int32, types.intp, types.int32))
clock_gettime = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.intp))


@compiled
def _look(words, header, parts, control, datagram, clock, descriptor):
    header[2], header[3] = parts.ctypes.data, 1  # struct msghdr, recvmsg(2)
    header[4], header[5] = control.ctypes.data, _CONTROL_BYTES
    parts[0], parts[1] = datagram.ctypes.data, _BYTES
    control[1] = 0
    size = _recvmsg(np.int32(descriptor), header.ctypes.data, np.int32(_PEEK))
    clock_gettime(np.int32(_REALTIME), clock.ctypes.data)
    now = clock[0] * _NANO + clock[1]
    clock_gettime(np.int32(_MONOTONIC), clock.ctypes.data)
    words[LOOKED] = clock[0] * _NANO + clock[1]
    words[ARRIVED], words[OLDEST], words[SIZE] = words[LOOKED], -1, size
    if size >= 8:
        words[OLDEST] = datagram[0].message_id
        if control[1] == _STAMP:
            words[ARRIVED] -= now - control[2] * _NANO - control[3]


@compiled
def _state(words, datagram, state, number):
    return unpack(datagram, words[SIZE], state, number)


class PeekedState:
    """The oldest state in an arm's socket. In the order look, take; neither of them waits or raises.

    words (WORDS,): of the last look.
    """

    def __init__(self, state: ArmState | None = None) -> None:
        """state: of the arm, which `take` writes to."""
        self.words = np.zeros(WORDS, np.int64)
        datagram, clock = np.zeros(1, ROBOT_STATE), np.zeros(2, np.int64)
        buffers = (np.zeros(7, np.int64), np.zeros(2, np.int64), np.zeros(8, np.int64), datagram)
        # look(descriptor): at the oldest state that waits in a socket, before it is read
        self.look = bound(_look, self.words, *buffers, clock, later=(0,))
        # take(number): that state was read; write it to the arm's, if it is the one that was looked at: see `unpack`
        self.take = bound(_state, self.words, datagram, (state or ArmState.empty()).record, later=(0,))


def stamp_arrivals(descriptor: int) -> None:
    """Have the kernel stamp what arrives at a socket; who reads it does not notice. Never raises."""
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(descriptor)) as sock:
        sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
