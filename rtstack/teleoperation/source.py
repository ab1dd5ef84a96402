"""Leads the arms after the requests of an operator or a policy: the mailbox's, filtered, are the plan's only point."""

import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from hal.limits import CONTROL_PERIOD_S
from rtstack.control.controller import ObservedArm
from rtstack.control.records import POINT
from rtstack.loop.end import End
from rtstack.loop.mailbox import TARGET, Mailbox, Release
from rtstack.loop.watchdogs import Watchdog, WatchdogTrip
from rtstack.model.rotation import quaternion_from_rotation
from rtstack.samples import SIDES, Level
from rtstack.teleoperation.follower import AIM, FOLLOWER, advance, aim, begin, compile_follower, hold, write_point
from rtstack.teleoperation.policy_lead import PolicyLead, quiet
from rtstack.teleoperation.reach import HARDEST_N_M, SLOWEST_M_S, SOFTEST_N_M, TURN_RAD_M, Reach
from rtstack.topics import HAND_TOPIC

_AGES = ("made_us", "made_ns"), ("came_us", "came_ns"), ("picture_us", "picture_ns"), ("seen_us", "seen_ns")
_DROPPED = ("dropped_old", "dropped_order", "dropped_picture", "dropped_other")
_QUIET = End.CLUTCH_QUIET, "signal"
_STIFFER_N_M = 500.0 * CONTROL_PERIOD_S  # a tick: a stiffness that jumped would be a force that jumps
_POSTURE_RAD = 0.3 * CONTROL_PERIOD_S  # a tick: the posture that a policy's joints ask for
RELEASE_TEXTS: dict[int, str] = {
    Release.RELEASED: "the clutch was let go",
    Release.LOST: "the page lost the operator's hand",
    Release.DROPPED: "a hand moved as no hand can, or was lost by its tracker",
}


def released(release: int) -> WatchdogTrip:
    """Return why a session ends whose clutch was let go."""
    return WatchdogTrip(End.RELEASED, RELEASE_TEXTS.get(release, "for no reason given"), Level.INFO)


class Clutch(Watchdog):
    """A watchdog that ends a session that no targets lead with its clutch. clock: the host's monotonic time, ns."""

    def __init__(self, mailbox: Mailbox, job: int, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._mailbox, self._job, self._clock = mailbox, job, clock
        self._target = np.zeros(1, TARGET)
        self._beat_ns = self._release = 0

    @property
    def held(self) -> bool:
        """Whether it is held now."""
        if self._mailbox.read_target(self._target) and self._target["job"][0] == self._job:
            self._beat_ns, self._release = int(self._target["clutch_ns"][0]), int(self._target["release"][0])
        return self._beat_ns > 0

    def trip(self) -> WatchdogTrip | None:
        return quiet(self._clock() - self._beat_ns, *_QUIET) if self.held else released(self._release)


class TeleoperationSource:
    """Follows the targets of one job. points (arms, 1) of POINT: the plan's, written each tick.

    stop_on_release: a clutch that is let go ends the session; otherwise the arms brake, hold, and wait for it. A clutch
    that goes quiet, or whose operator is out of sight, ends it always, as does a policy without an answer for CLUTCH_S.
    A policy leads while the target names its lease, until the clutch is held. clock: the host's monotonic time, ns.
    tell: called with a line when the lead changes hands. arms: those that were observed, once they were. sides: theirs.
    It is a sensor too (hal.sensor): of what was asked, on which picture, and when.
    """

    topic = HAND_TOPIC

    def __init__(
        self, mailbox: Mailbox, job: int, reach: Reach, stop_on_release: bool,
        clock: Callable[[], int] = time.monotonic_ns, sides: Sequence[str] = SIDES,
    ) -> None:  # fmt: skip
        arms = len(sides)
        self.points = np.zeros((arms, 1), POINT)
        self.moved = False  # whether the clutch was held
        self.lost = False  # whether it ended since the operator's hand was lost
        self._mailbox, self._job, self._reach, self._clock = mailbox, job, reach, clock
        self._stop_on_release = stop_on_release
        self._followers, self._aims = np.zeros((arms, 1), FOLLOWER), np.zeros((arms, 1), AIM)
        self._begun, self._held = [False] * arms, False
        self._target = np.zeros(1, TARGET)
        self._sequence = self._beat_ns = 0
        self._ended: WatchdogTrip | None = None  # by the newest target
        self._speed = SLOWEST_M_S
        self._stiffness = 0.0  # wanted; 0 before the first request: the plan's
        first = SIDES.index(sides[0])
        self._there = slice(first, first + arms)  # of what has a row of either side
        self._pose = self._target["pose"][0, self._there]
        self.lead = PolicyLead(mailbox, job, clock)
        self.tell: Callable[[str], None] = lambda _: None
        self.arms: list[ObservedArm | None] = [None] * arms
        self._stamp = np.zeros(1, np.int64)
        self._command = np.tile(np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), (2, 1))
        self._applied = self._logged = 0  # sequence words of the targets whose command was applied, and logged
        self._asked = 0  # its own sequence
        self._now_ns = self._logged_ns = -1  # the log's time
        compile_follower(arms)
        aim(self._pose, self._followers.copy(), self._aims, reach.lower, reach.upper)

    def listen(self) -> None:
        """See rtstack.loop.session.PointSource: take the target that was written since, and the policy's answer."""
        self._ended = self._take() if self._mailbox.target_sequence != self._sequence else None
        if self._ended is None and not self._held and self.lead.lease:
            self._follow_policy()

    def trip(self) -> WatchdogTrip | None:
        """See rtstack.loop.watchdogs.Watchdog: the clutch, the operator or the policy is done, or quiet."""
        if self._ended is not None:
            return self._ended
        if self._held:
            return quiet(self._clock() - self._beat_ns, *_QUIET)
        return self.lead.trip() if self.lead.lease else None

    def step(self, side: int, arm: ObservedArm) -> None:
        """Write the point of this tick of an arm whose state was observed."""
        follower, point = self._followers[side], self.points[side]
        if side == 0:
            self._now_ns = arm.sample["t_ns"].item()
        if not self._begun[side]:
            self._begun[side] = True
            work = arm.workspace[0]
            begin(follower, work["position"], work["rotation"])
            point["xi"] = arm.sample["q"][0, arm.parameters.posture_joint]
            self.arms[side] = arm
            if side == 0:
                self._stamp = arm.sample["t_ns"]
        advance(follower, self._speed, TURN_RAD_M * self._speed)
        write_point(follower, point)
        if self.lead.lease and np.isfinite(self.lead.xi[self._there][side]):
            point["xi"] += min(max(self.lead.xi[self._there][side] - point["xi"][0], -_POSTURE_RAD), _POSTURE_RAD)
        if self._stiffness:
            stiffness = arm.setpoint["stiffness"][0]
            if (now := stiffness[0]) != self._stiffness:
                stiffness[:3] = now + min(max(self._stiffness - now, -_STIFFER_N_M), _STIFFER_N_M)

    def read(self, sample: NDArray[np.void]) -> None:
        """Write the command that was applied since, (1,) of the topic /hand; see hal.sensor."""
        if self._applied == self._logged or self._now_ns <= self._logged_ns:
            return
        self._logged, self._logged_ns = self._applied, self._now_ns
        target, now_ns = self._target[0], self._clock()
        sample["t_ns"] = self._now_ns
        sample["asked_left"], sample["asked_right"] = target["pose"][0], target["pose"][1]
        sample["sequence"], sample["picture"] = target["sequence"], target["picture"]
        for age, at in _AGES:
            sample[age] = (now_ns - target[at]) * 1e-3
        for name, number in zip(_DROPPED, target["dropped"], strict=True):
            sample[name] = number

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
        if target["clutch_ns"] or target["policy"]:
            self._set(float(target["speed"]), float(target["stiffness"]))
        if not target["clutch_ns"]:
            self._lend(int(target["policy"]))
            return self._released(int(target["release"]))
        self._beat_ns = int(target["clutch_ns"])
        if self.lead.lease:
            self.lead.end()
            before_ms = (self._clock() - self._beat_ns) * 1e-6
            self.tell(f"the operator leads: the clutch was held {before_ms:.3f} ms before this tick")
        self._held = self.moved = True
        if target["sequence"] != self._asked:
            self._asked, self._applied = int(target["sequence"]), sequence
        if all(self._begun):
            aim(self._pose, self._followers, self._aims, self._reach.lower, self._reach.upper)
        return None

    def _set(self, speed: float, stiffness: float) -> None:
        if np.isfinite(speed):
            self._speed = min(max(speed, SLOWEST_M_S), self._reach.fastest_m_s)
        if np.isfinite(stiffness):
            self._stiffness = min(max(stiffness, SOFTEST_N_M), HARDEST_N_M)

    def _lend(self, lease: int) -> None:
        """Let a policy lead under a lease, or none; an operator's settings hold for it too."""
        if lease == self.lead.lease:
            return
        hold(self._followers)
        if not lease:
            self.lead.end()
            self.tell("the policy's lease is over: the arms hold")
            return
        self._held = False
        self.lead.begin(lease)
        self.tell(f"a policy leads, lease {lease}")

    def _follow_policy(self) -> None:
        """Make the goals of this tick of what the policy answered."""
        if not all(self._begun):
            return
        if not self.lead.answers:
            for command, point in zip(self._command[self._there], self.points[:, 0], strict=True):
                command[:3] = point["position"]
                quaternion_from_rotation(point["rotation"], command[3:])
        if self.lead.follow(int(self._stamp[0]), self._command):
            self.moved = True
            aim(self.lead.poses[self._there], self._followers, self._aims, self._reach.lower, self._reach.upper)

    def _released(self, release: int) -> WatchdogTrip | None:
        if not self._held:
            return None
        self._held = False
        if self._stop_on_release or release not in (Release.RELEASED, Release.DROPPED):
            self.lost = release != Release.RELEASED
            return released(release)
        if release == Release.DROPPED:
            self.tell(f"the grip was let go, and the arms hold: {RELEASE_TEXTS[release]}")
        hold(self._followers)
        return None
