"""What has to give a sign of life while the arms move. A session asks each watchdog once a tick, beside STOP.

A watchdog loads a word and compares: it never waits, opens, logs or raises. What it finds ends the session through the
judge's stop.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from math import nan
from typing import Protocol

from rtstack.loop.end import End
from rtstack.safety.permit import LEASE_S
from rtstack.samples import Level

CONSOLE_S = 1.0  # the console beats ten times a second; a page that it renders may keep it busy for some tenths
OPERATOR_S = LEASE_S


@dataclass(frozen=True, slots=True)
class Trip:
    """Why a watchdog ends a session. value and bound: what was found and what was allowed, where it is a number."""

    end: End
    detail: str
    level: Level = Level.ERROR
    value: float = nan
    bound: float = nan


class Watchdog(Protocol):
    """One thing that may go quiet."""

    def trip(self) -> Trip | None:
        """Return why the session has to stop, None while all is well. Asked once a tick; never waits or raises."""
        ...


class Heartbeat:
    """Trips where a word of signs of life has not moved on: `read_ns` gives the host's monotonic time of the last one.

    Who has never given one (0) is gone from the first tick on: beat before the session begins.
    """

    def __init__(self, read_ns: Callable[[], int], limit_s: float, end: End) -> None:
        self._read_ns = read_ns
        self._limit_s = limit_s
        self._limit_ns = round(limit_s * 1e9)
        self._end = end

    def trip(self) -> Trip | None:
        """See Watchdog."""
        last_ns = self._read_ns()
        silent_ns = time.monotonic_ns() - last_ns
        if silent_ns <= self._limit_ns:
            return None
        silent_s = silent_ns * 1e-9
        what = f"no sign of life for {silent_s:.3g} s" if last_ns else "it never gave a sign of life"
        return Trip(self._end, f"{what}, allowed {self._limit_s:g} s", value=silent_s, bound=self._limit_s)
