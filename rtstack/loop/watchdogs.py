"""What has to give a sign of life while the arms move. A session asks each watchdog once a tick, beside STOP.

A watchdog loads a word and compares: it never waits, opens, logs or raises. What it finds ends the session through the
judge's stop. docs/generate/watchdogs.py lists all of them, with the ones outside of the loop.
"""

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import nan
from typing import Protocol

from hal.limits import CONTROL_PERIOD_S
from rtstack.loop.command_echo import CommandEcho
from rtstack.loop.end import End
from rtstack.safety.arming import LEASE_S
from rtstack.safety.limits import LARGEST_GAP_S
from rtstack.samples import Level

CONSOLE_S = 1.0  # the console beats ten times a second; a page that it renders may keep it busy for some tenths
OPERATOR_S = LEASE_S
CLUTCH_S = 0.3  # of a clutch that is held: a page beats every 50 ms, and one that was busy is forgiven five of them
# The robot itself gives up after 20 answers in a row that came too late. Half of them leave the other half for the
# stop. A machine that stalls, for 3 to 20 ms now and then, makes one tick long and not the ten after each other.
OVERRUN_TICKS = round(LARGEST_GAP_S / CONTROL_PERIOD_S) // 2
# A robot that counts from the start of its motion gives up after 20 answers, and says so itself.
FIRST_TORQUE_TICKS = 50
# Ours: `rtstack check` fails a link that loses a tenth, and a machine that stalls now and then loses some hundredths
LOST_SHARE = 0.25
# FCI documentation, requirements of the network: round trip, control loop and the robot's own processing have 1 ms
# together. How it is shared is not published; half of it for the loop is ours.
SLOW_US = 0.5e6 * CONTROL_PERIOD_S
_MARK_TICKS, _MARKS = 100, 10
_PERIOD_NS = round(CONTROL_PERIOD_S * 1e9)


def since_boot_s() -> float:
    """Return the time since the host's start, s, suspended time included, which time.monotonic leaves out."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def slow_tick(median_us: float) -> str:
    """Return in one line that ticks of this median, us, are too slow for arms at 1 kHz, "" where they are not."""
    if not median_us > SLOW_US:
        return ""
    return (
        f"the median tick takes {median_us:.0f} us, allowed {SLOW_US:.0f}: arms at 1 kHz would lose answers; make the "
        "controller faster, or end other programs on this machine"
    )


@dataclass(frozen=True, slots=True)
class WatchdogTrip:
    """Why a session ends. value and bound: what was found and what was allowed, where it is a number. side: left or
    right, empty where it is not of one arm; joint: 1 to 7, 0 where it is of none."""

    end: End
    detail: str
    level: Level = Level.ERROR
    value: float = nan
    bound: float = nan
    side: str = ""
    joint: int = 0

    @property
    def text(self) -> str:
        """One line for people."""
        return f"{self.end}: {self.detail}" if self.detail else str(self.end)


class Watchdog(Protocol):
    """One thing that may go quiet."""

    def trip(self) -> WatchdogTrip | None:
        """Return why the session has to stop, None while all is well. Asked once a tick; never waits or raises."""


class Heartbeat(Watchdog):
    """Trips where a word of signs of life has not moved on: `read_ns` gives the host's monotonic time of the last one.
    One that has never given one (0) is gone from the first tick on: beat before the session begins."""

    def __init__(self, read_ns: Callable[[], int], limit_s: float, end: End) -> None:
        self._read_ns = read_ns
        self._limit_s = limit_s
        self._limit_ns = round(limit_s * 1e9)
        self._end = end

    def trip(self) -> WatchdogTrip | None:
        last_ns = self._read_ns()
        silent_ns = time.monotonic_ns() - last_ns
        if silent_ns <= self._limit_ns and last_ns:
            return None
        silent_s = silent_ns * 1e-9 if last_ns else nan
        what = f"no signal for {silent_s:.3g} s" if last_ns else "no signal yet"
        return WatchdogTrip(self._end, f"{what} (limit {self._limit_s:g} s)", value=silent_s, bound=self._limit_s)


class Parent(Watchdog):
    """Trips where the process that started this one has ended: the result is no longer needed."""

    def __init__(self) -> None:
        self._pid = os.getppid()

    def trip(self) -> WatchdogTrip | None:
        if os.getppid() == self._pid:
            return None
        return WatchdogTrip(End.PARENT_GONE, f"process {self._pid} has ended")


class TickOverrun(Watchdog):
    """Trips where the arms' turns together took longer than a period, OVERRUN_TICKS times in a row for one of them;
    only where the robot does not wait. One long turn counts once for each arm, and is forgotten with the next one."""

    def __init__(self, arms: int = 2) -> None:
        self._took_ns = [0] * arms
        self._long_ticks = [0] * arms

    def take(self, sides: tuple[int, ...], took_ns: int) -> None:
        """Take how long the turn of `sides` took, from its states to its end, without the wait for them."""
        for k in sides:
            self._took_ns[k] = took_ns // len(sides)
        long = sum(self._took_ns) > _PERIOD_NS
        for k in sides:
            self._long_ticks[k] = self._long_ticks[k] + 1 if long else 0

    def trip(self) -> WatchdogTrip | None:
        if max(self._long_ticks) < OVERRUN_TICKS:
            return None
        took_s = sum(self._took_ns) * 1e-9
        detail = f"{OVERRUN_TICKS} ticks in a row, the last one {1e3 * took_s:.3g} ms"
        return WatchdogTrip(End.TICK_OVERRUN, detail, value=took_s, bound=CONTROL_PERIOD_S)


class FirstTorque(Watchdog):
    """Trips where one arm has shown a torque of ours, and the other one none in FIRST_TORQUE_TICKS of its states: its
    robot holds it while the first one moves. Where neither shows one, neither moves.
    """

    def __init__(self, echoes: Mapping[str, CommandEcho]) -> None:
        """echoes: of each arm, by its side."""
        self._pairs = [
            (side, echo, other) for side, echo in echoes.items() for name, other in echoes.items() if name != side
        ]

    def trip(self) -> WatchdogTrip | None:
        for side, echo, other in self._pairs:
            if other.seen and not echo.seen and echo.lost >= FIRST_TORQUE_TICKS:
                return WatchdogTrip(
                    End.TORQUE_NOT_TAKEN, f"the {side} arm shows none of its first {echo.lost} torques",
                    value=echo.lost, bound=FIRST_TORQUE_TICKS, side=side,
                )  # fmt: skip
        return None


class LostAnswers(Watchdog):
    """Trips where more than LOST_SHARE of an arm's answers within about a second came too late: its robot repeats
    torques that were right for other states. Asked once for each state of an arm.
    """

    def __init__(self, echoes: Mapping[str, CommandEcho]) -> None:
        """echoes: of each arm, by its side."""
        self._arms = [(side, echo, [0] * _MARKS) for side, echo in echoes.items()]
        self._asked = 0

    def trip(self) -> WatchdogTrip | None:
        self._asked += 1
        number, between = divmod(self._asked, _MARK_TICKS * len(self._arms))
        if between:
            return None
        for side, echo, marks in self._arms:
            lost, marks[number % _MARKS] = echo.lost - marks[number % _MARKS], echo.lost
            if lost > LOST_SHARE * _MARK_TICKS * _MARKS:
                detail = f"{lost} of the last {_MARK_TICKS * _MARKS} answers to the {side} arm came too late"
                return WatchdogTrip(End.TORQUE_NOT_TAKEN, detail, value=lost, side=side)
        return None
