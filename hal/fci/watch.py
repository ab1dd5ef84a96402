"""Waiting for the states of several arms without sleeping through the moment when they come.

A thread that sleeps in a read is woken some 50 to 100 us late, more on a virtual machine. States come every
millisecond: so it sleeps until shortly before the next one is due, and then looks without sleeping, for a fifth of the
time at most, which is far from what the kernel takes from a real-time thread that never rests.
"""

import select
import time
from collections.abc import Iterable

PERIOD_NS = 1_000_000
EARLY_NS = 120_000  # what timers and wake-ups may take
LATE_NS = 100_000  # a state that is later than this is waited for asleep


class StateWatch:
    """Watches sockets (descriptors) on which a state arrives every millisecond."""

    def __init__(self, descriptors: Iterable[int]) -> None:
        self._epoll = select.epoll()
        self._due_ns = dict.fromkeys(descriptors, 0)
        for descriptor in self._due_ns:
            self._epoll.register(descriptor, select.EPOLLIN)
        self._wait_list = [self._epoll]

    def wait(self, timeout_s: float) -> list[int]:
        """Return the descriptors that can be read: as soon as there is one, none after about `timeout_s`."""
        poll, clock = self._epoll.poll, time.monotonic_ns
        now_ns = clock()
        due_ns = min((due for due in self._due_ns.values() if due > now_ns - LATE_NS), default=now_ns)
        spare_ns = due_ns - EARLY_NS - now_ns
        if spare_ns > 0:
            # epoll alone rounds to milliseconds; select on the epoll's own descriptor does not
            select.select(self._wait_list, (), (), spare_ns * 1e-9)
        events = poll(0)
        while not events and clock() < due_ns + LATE_NS:
            events = poll(0)
        events = events or poll(timeout_s)
        now_ns = clock()
        ready = [descriptor for descriptor, _ in events]
        for descriptor in ready:
            self._due_ns[descriptor] = now_ns + PERIOD_NS
        return ready

    def close(self) -> None:
        """Release the descriptor."""
        self._epoll.close()
