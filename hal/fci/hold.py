"""Answers one arm while this process is blocked in a call to the other one.

libfranka waits in start, stop and the end of a motion until the control box has changed its mode, and pylibfranka keeps
Python's lock meanwhile: nothing else of this process runs. An arm in motion that gets no answer for 20 ms stops with
communication_constraints_violation. So compiled code, which needs no lock, answers that arm's states with its last
command, as the robot itself does where a packet is lost. It reads and writes the socket that libfranka has opened:
libfranka takes the newest state that it finds, and finds a later one afterwards.
"""

import threading
import time
from collections.abc import Callable
from queue import SimpleQueue
from typing import Protocol

import numpy as np
from numba import types

from hal.base.arrays import Array
from hal.base.realtime import beside_realtime
from hal.compilation import bound, compiled
from hal.wire import ROBOT_COMMAND, ROBOT_STATE

GRACE_NS = 3_000_000  # a call that is over by then has cost three packets of 20; a robot's start takes about 2 ms
# the arm is let go: it stops by itself, as where this host hangs. Longer than libfranka waits for a state, 1 s
LONGEST_NS = 2_000_000_000
# and where a joint gets faster by this than it was: the judge does not see it meanwhile, and a torque that was right at
# one place and time is not at another. Ours: a tenth of what an FR3's slowest joint may do
FASTER_RAD_S = 0.2
_POLL_MS = 1
_DONTWAIT = 0x40  # MSG_DONTWAIT, sys/socket.h
_ADDRESS_BYTES = 16  # of sockaddr_in
_RUNNING, _STOP, _ANSWERS = 0, 1, 2  # of the words that both threads share

_poll = types.ExternalFunction("poll", types.int32(types.intp, types.uint64, types.int32))
_recvfrom = types.ExternalFunction(
    "recvfrom", types.int64(types.int32, types.intp, types.uint64, types.int32, types.intp, types.intp)
)
_sendto = types.ExternalFunction(
    "sendto", types.int64(types.int32, types.intp, types.uint64, types.int32, types.intp, types.uint32)
)


@compiled(nogil=True)
def _answer(words, watched, state, command, address, address_size, descriptor, polls, grace_polls):
    """Answer until words[_STOP]. watched: a pollfd (2,) of int32."""
    words[_RUNNING] = 1
    faster = FASTER_RAD_S * np.ones(7)
    first = True
    for poll in range(polls):
        if words[_STOP] != 0:
            break
        if poll < grace_polls:
            _poll(watched.ctypes.data, np.uint64(0), np.int32(_POLL_MS))
            continue
        if _poll(watched.ctypes.data, np.uint64(1), np.int32(_POLL_MS)) <= 0:
            continue
        if words[_STOP] != 0:
            break  # this state is libfranka's
        address_size[0] = _ADDRESS_BYTES
        size = _recvfrom(
            np.int32(descriptor), state.ctypes.data, np.uint64(state.itemsize), np.int32(_DONTWAIT),
            address.ctypes.data, address_size.ctypes.data,
        )  # fmt: skip
        if size != state.itemsize:
            continue
        for j in range(7):
            if first:
                faster[j] += abs(state[0].dq[j])
            if not abs(state[0].dq[j]) <= faster[j]:
                return
        first = False
        command[0].message_id = state[0].message_id
        _sendto(
            np.int32(descriptor), command.ctypes.data, np.uint64(command.itemsize), np.int32(0),
            address.ctypes.data, np.uint32(_ADDRESS_BYTES),
        )  # fmt: skip
        words[_ANSWERS] += 1


class Held(Protocol):
    """An arm in motion that can be answered without libfranka."""

    socket: int

    def last_torque(self) -> Array:
        """Return the torque (7,), Nm, of its last command."""
        ...


class HoldThread:
    """The thread that answers: there from the beginning, since a busy host starts a new one tens of ms late."""

    def __init__(self) -> None:
        self._work: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        threading.Thread(target=self._run, daemon=True, name="hold").start()

    def _run(self) -> None:
        beside_realtime()
        while (work := self._work.get()) is not None:
            work()

    def hold(self, arm: Held) -> "Hold":
        """Return the context in which an arm is answered with its last command."""
        return Hold(arm, self._work.put)

    def close(self) -> None:
        """End the thread."""
        self._work.put(None)


class Hold:
    """A context in which an arm is answered. `answers` of its states, afterwards."""

    def __init__(self, arm: Held, begin: Callable[[Callable[[], None]], None]) -> None:
        self.answers = 0
        self._begin, self._ended = begin, threading.Event()
        self._words = np.zeros(3, dtype=np.int64)
        command, state = np.zeros(1, ROBOT_COMMAND), np.zeros(1, ROBOT_STATE)
        command["tau_J_d"] = arm.last_torque()
        watched = np.array([arm.socket, 1], dtype=np.int32)  # struct pollfd: the descriptor, POLLIN in the lower half
        self._answer = bound(
            _answer, self._words, watched, state, command, np.zeros(_ADDRESS_BYTES, dtype=np.uint8),
            np.zeros(1, dtype=np.uint32), arm.socket, LONGEST_NS // 1_000_000, GRACE_NS // 1_000_000,
        )  # fmt: skip

    @property
    def ended(self) -> bool:
        """Whether the arm is answered no more."""
        return self._ended.is_set()

    def _run(self) -> None:
        self._answer()
        self._ended.set()

    def __enter__(self) -> "Hold":
        self._begin(self._run)
        # the next call keeps Python's lock, which that thread needs to begin; asleep, for its priority may be the lower
        while not self._words[_RUNNING]:
            time.sleep(20e-6)
        return self

    def __exit__(self, *_: object) -> None:
        self._words[_STOP] = 1
        self._ended.wait()
        self.answers = int(self._words[_ANSWERS])
