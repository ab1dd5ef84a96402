"""The cycles of a run that has no log: kept in memory, to say afterwards who was late."""

import numpy as np

from hal.cycle import CYCLE, WORK, Cycles
from hal.host_work import HostWork
from rtstack.log.lateness import Lateness, lateness

STATE = np.dtype([("t_ns", "i8"), ("control_command_success_rate", "f8")])


class CycleLog:
    """Room for so many cycles of each arm, within its context. cycles: None where they are not measured."""

    def __init__(self, cycles: tuple[Cycles, Cycles] | None, ticks: int) -> None:
        self._cycles, self._work, self._room = cycles, HostWork(), ticks
        self._kept, self._states = np.zeros((2, ticks), CYCLE), np.zeros((2, ticks), STATE)
        self._host = np.zeros(2 * ticks, WORK)
        self._count, self._read = [0, 0], 0

    def __enter__(self) -> "CycleLog":
        self._work.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._work.__exit__()

    def take(self, side: int, t_ns: int, success_rate: float) -> None:
        """Take the cycle of an arm that was just answered, beyond the room nothing."""
        n = self._count[side]
        if self._cycles is None or n >= self._room:
            return
        self._count[side] = n + 1
        self._kept[side, n] = self._cycles[side].sample[0]
        self._kept["t_ns"][side, n] = t_ns
        self._states[side, n] = t_ns, success_rate
        if self._work.cycle(self._cycles[side].late):
            self._host[self._read] = self._work.sample[0]
            self._read += 1

    def lateness(self) -> Lateness | None:
        """Return who was late, by the left arm's clock; None where cycles are not measured."""
        if self._cycles is None or min(self._count) == 0:
            return None
        kept, states = ([rows[k, : self._count[k]] for k in (0, 1)] for rows in (self._kept, self._states))
        ahead_ns = kept[1]["t_ns"][0] - kept[0]["t_ns"][0]
        for rows in (kept, states):
            rows[1]["t_ns"] -= ahead_ns
        return lateness(kept, states, self._host[: self._read])
