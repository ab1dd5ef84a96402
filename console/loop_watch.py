"""How well the loop keeps time, from its ring."""

from dataclasses import dataclass

import numpy as np

from rtstack.log.ring import RingReader

_WINDOW = 2000  # ticks, 2 s: what period and p99 are about


@dataclass(frozen=True, slots=True)
class LoopView:
    """The loop over the last 2 s. Periods us; None before the first tick; missed since the console started."""

    period_us: float | None
    period_p99_us: float | None
    missed: int


class LoopWatch:
    """Follows /timing."""

    def __init__(self, reader: RingReader) -> None:
        self._reader = reader
        self._periods = np.empty(0)
        self._missed = 0
        self._counted = 0

    def view(self) -> LoopView:
        """Take the ticks since the last call, and return the view over the newest."""
        records = self._reader.drain()
        if len(records):
            periods = records["period_us"]
            self._periods = np.concatenate([self._periods, periods[np.isfinite(periods)]])[-_WINDOW:]
            counts = np.concatenate([[self._counted], records["missed_deadlines"]])
            steps = np.diff(counts)  # each job counts from zero again
            self._missed += int(np.where(steps >= 0, steps, counts[1:]).sum())
            self._counted = int(counts[-1])
        if not len(self._periods):
            return LoopView(None, None, self._missed)
        return LoopView(float(self._periods.mean()), float(np.percentile(self._periods, 99)), self._missed)
