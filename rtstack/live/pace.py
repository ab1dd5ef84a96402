"""Pace of a simulated cell that a person watches: real time where the machine can, slower where it cannot."""

import time

_PERIOD_NS = 1_000_000
_FINAL_WAIT_NS = 60_000  # time.sleep wakes up late by the kernel's timer slack: the rest is waited for
_LARGEST_DEBT_NS = 20_000_000  # after a longer pause it does not hurry to catch up


class PacedLockstep:
    """A clock for the plant that never skips a millisecond: the robot waits for its answer, as in lockstep.

    So a busy machine makes the simulation slow, which the loop's period shows, and never makes it wrong: a seed
    gives the same states as in a run without a clock. `missed` stays 0.
    """

    def __init__(self) -> None:
        self.missed = 0
        self._deadline_ns = time.monotonic_ns()

    def wait(self) -> int:
        """Sleep until the next millisecond is due, or not at all when it is late. Returns 1, the plant's next ms."""
        self._deadline_ns = max(self._deadline_ns + _PERIOD_NS, time.monotonic_ns() - _LARGEST_DEBT_NS)
        spare_ns = self._deadline_ns - time.monotonic_ns() - _FINAL_WAIT_NS
        if spare_ns > 0:
            time.sleep(spare_ns * 1e-9)
        while time.monotonic_ns() < self._deadline_ns:
            pass
        return 1
