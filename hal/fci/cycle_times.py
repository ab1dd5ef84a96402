"""When the kernel received each state of an arm (hal.fci.peeked_state), and when the loop read and answered it."""

import time

import numpy as np

from hal.compilation import bound, compiled
from hal.cycle import CYCLE
from hal.fci.peeked_state import ARRIVED, LOOKED, OLDEST, PeekedState
from hal.host_work import MONOTONIC, now_ns

LATE_NS = 500_000  # from when the host's counters are read: half of what the robot allows
_TICK_NS = 1_000_000
_LAST_T, _LAST_ARRIVED, _LATE, _WORDS = range(4)


@compiled
def _answer(looked, words, sample, clock, free_ns, read_ns, t_ns):
    arrived = looked[ARRIVED]
    answered = now_ns(MONOTONIC, clock) - arrived
    oldest = looked[OLDEST] * _TICK_NS if looked[OLDEST] >= 0 else t_ns
    cycle = sample[0]
    cycle.arrived_us = 1e-3 * arrived
    cycle.unread = max(1, (t_ns - oldest) // _TICK_NS + 1)
    cycle.free_us = 1e-3 * (free_ns - arrived)
    cycle.seen_us = 1e-3 * (looked[LOOKED] - arrived)
    cycle.read_us = 1e-3 * (read_ns - arrived)
    cycle.answered_us = 1e-3 * answered
    came_late = (arrived - words[_LAST_ARRIVED]) - (oldest - words[_LAST_T])
    late = answered > LATE_NS or cycle.unread > 1 or t_ns - words[_LAST_T] > _TICK_NS or came_late > LATE_NS
    words[_LATE] = 1 if late else 0
    words[_LAST_T], words[_LAST_ARRIVED] = t_ns, arrived + (t_ns - oldest)


class CycleTimes:
    """The cycles of one arm: a hal.cycle.Cycles. After a look, in the order read, answer; neither waits or raises."""

    def __init__(self, peeked: PeekedState) -> None:
        """peeked: what was looked at before each read."""
        self.sample = np.zeros(1, CYCLE)
        self.free_ns = 0  # when the loop had ended its last cycle, of the monotonic clock
        self._read_ns = 0
        self._words = np.zeros(_WORDS, np.int64)
        self._answer = bound(_answer, peeked.words, self._words, self.sample, np.zeros(2, np.int64), later=(0, 0, 0))

    def read(self) -> None:
        self._read_ns = time.monotonic_ns()

    def answer(self, t_ns: int) -> None:
        """Note that the state of this robot's time was answered: now `sample` and `late` are of this cycle."""
        self._answer(self.free_ns, self._read_ns, t_ns)

    @property
    def late(self) -> bool:
        return bool(self._words[_LATE])
