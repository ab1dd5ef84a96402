"""Answers one arm while this process is blocked in a call to the other one.

libfranka waits in start, stop and the end of a motion until the control box has changed its mode, and pylibfranka keeps
Python's lock meanwhile. An arm in motion that gets no answer for 20 ms stops with communication_constraints_violation.
So compiled code, which needs no lock, answers that arm's states with its last command, as the robot itself does where a
packet is lost, on the socket that libfranka has opened: libfranka takes the newest state that it finds afterwards.
"""

import threading
import time
from collections.abc import Callable
from math import sqrt
from queue import SimpleQueue
from typing import Protocol

import numpy as np
from numba import types

from hal.base.arrays import Array
from hal.base.realtime import beside_realtime
from hal.compilation import bound, compiled
from hal.limits import HoldBounds
from hal.wire import ROBOT_COMMAND, ROBOT_STATE

GRACE_NS = 3_000_000  # a call that is over by then has cost three packets of 20; a robot's start takes about 2 ms
# the arm is let go: it stops by itself, as where this host hangs. Longer than libfranka waits for a state, 1 s
LONGEST_NS = 2_000_000_000
# and where a joint gets faster by this than it was: the judge does not see it meanwhile, and a torque that was right at
# one place and time is not at another. Ours: a tenth of what an FR3's slowest joint may do
FASTER_RAD_S = 0.2
FURTHER_RAD = 0.02  # ours, and where a joint has moved by this since the hold began: 17 mm at the reach of 0.855 m
_POLL_MS = 1
_DONTWAIT = 0x40  # MSG_DONTWAIT, sys/socket.h
_ADDRESS_BYTES = 16  # of sockaddr_in
_RUNNING, _STOP, _ANSWERS, _ENDED_BY, _JOINT = range(5)  # of the words that both threads share
# words[_ENDED_BY]: the bound that ended a hold, 0 for none
_ENDS = (
    "", "joint {joint} moves at {value:.3g} rad/s", "joint {joint} has moved by {value:.3g} rad",
    "joint {joint} is at {value:.4g} rad", "joint {joint} feels {value:.3g} Nm", "the pad pushes with {value:.3g} N",
)  # fmt: skip

_message = types.int32, types.intp, types.uint64, types.int32, types.intp  # descriptor, data, size, flags, address
_poll = types.ExternalFunction("poll", types.int32(types.intp, types.uint64, types.int32))
_recvfrom = types.ExternalFunction("recvfrom", types.int64(*_message, types.intp))
_sendto = types.ExternalFunction("sendto", types.int64(*_message, types.uint32))


@compiled
def _note(words, found, by, joint, value, allowed):
    words[_ENDED_BY], words[_JOINT] = by, joint + 1
    found[0], found[1] = value, allowed
    return True


@compiled
def _outside(state, began, bounds, force_max, words, found):
    """Return whether a state is outside its bounds, or no number, and note which bound. bounds (4, 7): the rows of
    HoldBounds; began (2, 7): where the hold began, rad, and the speed allowed, rad/s."""
    for j in range(7):
        q, dq, tau, lower, upper = state.q[j], state.dq[j], state.tau_ext_hat_filtered[j], bounds[0, j], bounds[1, j]
        if not abs(dq) <= began[1, j]:
            return _note(words, found, 1, j, dq, began[1, j])
        if not abs(q - began[0, j]) <= FURTHER_RAD:
            return _note(words, found, 2, j, q - began[0, j], FURTHER_RAD)
        # not where it begins beyond its range: a hand may be leading it back
        if lower <= began[0, j] <= upper and not lower <= q <= upper:
            return _note(words, found, 3, j, q, lower if q < lower else upper)
        if not abs(tau) <= bounds[3, j]:
            return _note(words, found, 4, j, tau, bounds[3, j])
    F = state.O_F_ext_hat_K
    force = sqrt(F[0] * F[0] + F[1] * F[1] + F[2] * F[2])
    return not force <= force_max and _note(words, found, 5, 0, force, force_max)


@compiled(nogil=True)
def _answer(
    words, watched, state, command, address, address_size, began, bounds, found, force_max, descriptor, polls, grace
):  # fmt: skip
    """Answer until words[_STOP]. watched: a pollfd (2,) of int32."""
    words[_RUNNING] = 1
    first = True
    for poll in range(polls):
        if words[_STOP] != 0:
            break
        if poll < grace:
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
        if first:
            for j in range(7):
                began[0, j] = state[0].q[j]
                began[1, j] = min(bounds[2, j], FASTER_RAD_S + abs(state[0].dq[j]))
            first = False
        if _outside(state[0], began, bounds, force_max, words, found):
            return
        command[0].message_id = state[0].message_id
        _sendto(
            np.int32(descriptor), command.ctypes.data, np.uint64(command.itemsize), np.int32(0),
            address.ctypes.data, np.uint32(_ADDRESS_BYTES),
        )  # fmt: skip
        words[_ANSWERS] += 1


class Held(Protocol):
    """An arm in motion that can be answered without libfranka.

    hold_bounds: outside of them it is answered no more; let_go: how long the last hold lasted and which bound ended it,
    in words to follow the arm's name, or "".
    """

    socket: int
    hold_bounds: HoldBounds
    let_go: str

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
        self._work.put(None)


class Hold:
    """A context in which an arm is answered. `answers` of its states, afterwards."""

    def __init__(self, arm: Held, begin: Callable[[Callable[[], None]], None]) -> None:
        self.answers, self._arm, bounds = 0, arm, arm.hold_bounds
        self._begin, self._ended = begin, threading.Event()
        self._words, self._found = np.zeros(5, dtype=np.int64), np.zeros(2)
        command, state = np.zeros(1, ROBOT_COMMAND), np.zeros(1, ROBOT_STATE)
        command["tau_J_d"] = arm.last_torque()
        watched = np.array([arm.socket, 1], dtype=np.int32)  # struct pollfd: the descriptor, POLLIN in the lower half
        self._answer = bound(
            _answer, self._words, watched, state, command, np.zeros(_ADDRESS_BYTES, dtype=np.uint8),
            np.zeros(1, dtype=np.uint32), np.zeros((2, 7)),
            np.array((bounds.q_lower, bounds.q_upper, bounds.dq_max, bounds.tau_ext_max)), self._found,
            float(bounds.force_max), arm.socket, LONGEST_NS // 1_000_000, GRACE_NS // 1_000_000,
        )  # fmt: skip

    @property
    def ended(self) -> bool:
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
        self.answers, (value, allowed) = int(self._words[_ANSWERS]), self._found
        ended_by = _ENDS[self._words[_ENDED_BY]].format(joint=self._words[_JOINT], value=value)
        how_long = f" (held for {self.answers} ms while the other arm's box was awaited, then let go: {ended_by}"
        self._arm.let_go = ended_by and f"{how_long}, allowed {allowed:.4g})"
