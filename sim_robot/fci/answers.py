"""How long a client took to answer each state, as the robot sees it: by the clock of the host that serves."""

import numpy as np

_BIN_NS = 5_000
_BINS = 400  # 2 ms: a later answer was dropped anyhow
_LAST = _BINS - 1


class AnswerTimes:
    """A histogram of the time from a state to its answer's arrival. lost: states that got none in time."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, dtype=np.int64)
        self.lost = 0

    def note(self, elapsed_ns: int) -> None:
        """Count one answer."""
        self._counts[min(elapsed_ns // _BIN_NS, _LAST)] += 1

    @property
    def answers(self) -> int:
        """Answers so far."""
        return int(self._counts.sum())

    def percentile_us(self, share: float) -> float:
        """Return the upper edge of the bin below which `share` percent of the answers lie, us; NaN without answers."""
        total = np.cumsum(self._counts)
        if not total[-1]:
            return float("nan")
        return 1e-3 * _BIN_NS * (1 + int(np.searchsorted(total, share / 100.0 * total[-1])))

    def report(self) -> str:
        """One line for people."""
        if not self.answers:
            return "no answers"
        p50, p99, p999 = (self.percentile_us(share) for share in (50.0, 99.0, 99.9))
        return f"{self.answers} answers, after {p50:.0f} us p50, {p99:.0f} p99, {p999:.0f} p99.9; {self.lost} lost"
