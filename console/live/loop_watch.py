"""How well the loop keeps time, from its ring."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from hal.limits import CONTROL_PERIOD_S
from rtstack.log.ring import RingReader

_WINDOW = 2000  # ticks, 2 s: what period, p99 and missed share are about
_PERIOD_US = 1e6 * CONTROL_PERIOD_S
# libfranka leaves 300 us of a period to the answer (docs, "system requirements"; `rtstack check` has the same bound)
_LATE_US = 300.0
_GOOD = 0.95  # share of answers in time below which libfranka speaks of many lost packets (communication_test.cpp)


class Keeping(StrEnum):
    """How well something keeps time: as it should, so that it is to be looked after, so that the robot may give up."""

    GOOD = "good"
    LATE = "late"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class LoopView:
    """The loop over the last 2 s. Periods us; None before the first tick; missed since the console started.

    lateness: what the 99th percentile of the periods means; losses: what the ticks that were missed in the 2 s mean.
    """

    period_us: float | None = None
    period_p99_us: float | None = None
    missed: int = 0
    lateness: Keeping = Keeping.GOOD
    losses: Keeping = Keeping.GOOD


class LoopWatch:
    """Follows /timing."""

    def __init__(self, reader: RingReader) -> None:
        self._reader = reader
        self._periods = np.empty(0)
        self._missed_each = np.empty(0)  # ticks missed before each of the newest records
        self._missed = self._counted = 0

    def view(self) -> LoopView:
        """Take the ticks since the last call, and return the view over the newest."""
        records = self._reader.drain()
        if len(records):
            periods = records["period_us"]
            self._periods = np.concatenate([self._periods, periods[np.isfinite(periods)]])[-_WINDOW:]
            counts = np.concatenate([[self._counted], records["missed_deadlines"]])
            steps = np.diff(counts)  # each job counts from zero again
            missed = np.where(steps >= 0, steps, counts[1:])
            self._missed += int(missed.sum())
            self._missed_each = np.concatenate([self._missed_each, missed])[-_WINDOW:]
            self._counted = int(counts[-1])
        if not len(self._periods):
            return LoopView(missed=self._missed)
        p99_us = float(np.percentile(self._periods, 99))
        lost = float(self._missed_each.sum())
        in_time = 1.0 - lost / (lost + len(self._missed_each))
        lateness = Keeping.GOOD if p99_us < _PERIOD_US + _LATE_US else Keeping.LATE
        losses = Keeping.GOOD if lost == 0.0 else Keeping.LATE if in_time >= _GOOD else Keeping.BAD
        return LoopView(float(self._periods.mean()), p99_us, self._missed, lateness, losses)
