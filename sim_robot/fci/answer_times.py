"""How long a client takes to answer a state."""

import numpy as np

_BIN_NS, _BINS = 5_000, 400  # an answer later than 2 ms is dropped anyway


class AnswerTimes:
    """A histogram of the times from a state to its answer's arrival, by this host's clock. lost: states without one."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, dtype=np.int64)
        self.lost = 0

    def note(self, elapsed_ns: int) -> None:
        self._counts[min(elapsed_ns // _BIN_NS, _BINS - 1)] += 1

    def report(self) -> str:
        """One line for people. A percentile is the upper edge of the bin in which it lies."""
        total = np.cumsum(self._counts)
        if not total[-1]:
            return "no answers"
        shares = np.array([50.0, 99.0, 99.9]) / 100.0 * total[-1]
        p50, p99, p999 = 1e-3 * _BIN_NS * (1 + np.searchsorted(total, shares))
        return f"{total[-1]} answers, after {p50:.0f} us p50, {p99:.0f} p99, {p999:.0f} p99.9; {self.lost} lost"
