"""Leads the arms after an operator's requests: the mailbox's targets, filtered, become the plan's only point.

It is asked once a tick, as a watchdog too, for what holds the clutch is what keeps the arms going.
"""

import time
from collections.abc import Callable

import numpy as np

from hal.limits import CONTROL_PERIOD_S
from rtstack.control.controller import ObservedArm
from rtstack.control.records import POINT
from rtstack.loop.end import End
from rtstack.loop.mailbox import Mailbox
from rtstack.loop.target import TARGET, Release
from rtstack.loop.watchdogs import WatchdogTrip
from rtstack.samples import Level
from rtstack.teleoperation.aim import AIM, aim
from rtstack.teleoperation.clutch import quiet, released
from rtstack.teleoperation.follower import FOLLOWER, advance, begin, hold, write_point
from rtstack.teleoperation.reach import FASTEST_M_S, HARDEST_N_M, SLOWEST_M_S, SOFTEST_N_M, TURN_RAD_M, Reach

_STIFFER_N_M = 500.0 * CONTROL_PERIOD_S  # a tick: a stiffness that jumped would be a force that jumps


class TeleoperationGuide:
    """Follows the targets of one job. points (2, 1) of POINT: the plan's, written each tick.

    stop_on_release: a clutch that is let go ends the session; otherwise the arms brake, hold, and wait for it. A clutch
    that goes quiet, or whose operator is out of sight, ends it always. clock: the host's monotonic time, ns.
    """

    def __init__(
        self, mailbox: Mailbox, job: int, reach: Reach, stop_on_release: bool,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:  # fmt: skip
        self.points = np.zeros((2, 1), POINT)
        self.moved = False  # whether the clutch was held
        self._mailbox = mailbox
        self._job = job
        self._reach = reach
        self._stop_on_release = stop_on_release
        self._clock = clock
        self._followers = np.zeros((2, 1), FOLLOWER)
        self._begun = [False, False]
        self._target = np.zeros(1, TARGET)
        self._sequence = 0
        self._held = False
        self._beat_ns = 0
        self._speed = SLOWEST_M_S
        self._stiffness = 0.0  # wanted; 0 before the first request: the plan's
        self._aims = np.zeros((2, 1), AIM)
        self._pose = self._target["pose"][0]
        self._compile()

    def _compile(self) -> None:
        """Have everything compiled before the first tick."""
        followers, point = self._followers.copy(), self.points[0].copy()
        begin(followers[0], np.zeros(3), np.eye(3))
        aim(self._pose, followers, self._aims, self._reach.lower, self._reach.upper)
        hold(followers[0])
        advance(followers[0], 0.1, 0.1)
        write_point(followers[0], point)

    def trip(self) -> WatchdogTrip | None:
        """See rtstack.loop.watchdogs.Watchdog: take what was written since, and notice who let go."""
        if self._mailbox.target_sequence != self._sequence:
            ended = self._take()
            if ended is not None:
                return ended
        return quiet(self._clock() - self._beat_ns) if self._held else None

    def step(self, side: int, arm: ObservedArm) -> None:
        """Write the point of this tick of an arm whose state was observed."""
        follower, point = self._followers[side], self.points[side]
        if not self._begun[side]:
            self._begun[side] = True
            work = arm.workspace[0]
            begin(follower, work["position"], work["rotation"])
            joint = arm.parameters.posture_joint
            point["xi"] = arm.sample["q"][0, joint]
        advance(follower, self._speed, TURN_RAD_M * self._speed)
        write_point(follower, point)
        if self._stiffness:
            stiffness = arm.setpoint["stiffness"][0]
            now = stiffness[0]
            if now != self._stiffness:
                stiffness[:3] = now + min(max(self._stiffness - now, -_STIFFER_N_M), _STIFFER_N_M)

    def _take(self) -> WatchdogTrip | None:
        """Take a new target. One that is being written, or is not of this job, counts for nothing."""
        sequence = self._mailbox.target_sequence
        if not self._mailbox.read_target(self._target):
            return None
        self._sequence = sequence
        target = self._target[0]
        if target["job"] != self._job:
            return None
        if target["finish"]:
            return WatchdogTrip(End.COMPLETED, "", Level.INFO)
        if not target["clutch_ns"]:
            return self._released(int(target["release"]))
        self._held = self.moved = True
        self._beat_ns = int(target["clutch_ns"])
        if np.isfinite(target["speed"]):
            self._speed = min(max(float(target["speed"]), SLOWEST_M_S), FASTEST_M_S)
        if np.isfinite(target["stiffness"]):
            self._stiffness = min(max(float(target["stiffness"]), SOFTEST_N_M), HARDEST_N_M)
        if all(self._begun):
            aim(self._pose, self._followers, self._aims, self._reach.lower, self._reach.upper)
        return None

    def _released(self, release: int) -> WatchdogTrip | None:
        if not self._held:
            return None
        self._held = False
        if self._stop_on_release or release != Release.RELEASED:
            return released(release)
        for follower in self._followers:
            hold(follower)
        return None
