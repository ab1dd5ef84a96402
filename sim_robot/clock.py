"""What paces the plant when it must keep real time. In lockstep there is no clock."""

import time

PERIOD_NS = 1_000_000
# time.sleep wakes up late by the kernel's timer slack; the rest of the wait is this short
FINAL_WAIT_NS = 60_000
LARGEST_DEBT_NS = 20_000_000
# of the time since the last rest, at most a millisecond: a real-time thread that never sleeps keeps its CPU to itself
LEAST_REST = 0.1


class PacedLockstep:
    """Paces the cell, a `wait` for each state. It skips no millisecond: a busy machine makes it slow, never wrong."""

    def __init__(self) -> None:
        self._deadline_ns = self._rested_ns = time.monotonic_ns()

    def wait(self) -> None:
        """Sleep until the next millisecond is due, and a little where it is late."""
        now = time.monotonic_ns()
        # after a longer pause it does not hurry to catch up
        self._deadline_ns = max(self._deadline_ns + PERIOD_NS, now - LARGEST_DEBT_NS)
        rest_ns = min(round(LEAST_REST * (now - self._rested_ns)), PERIOD_NS)
        spare_ns = max(self._deadline_ns - now - FINAL_WAIT_NS, rest_ns)
        time.sleep(spare_ns * 1e-9)
        self._rested_ns = time.monotonic_ns()
        while time.monotonic_ns() < self._deadline_ns:
            pass
