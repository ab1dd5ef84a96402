"""Which unexpected: what it probably was, by what the monitor has found and what the arms felt before and after.

Beyond the paper, which stops at expected or unexpected. Every number of the rules can be checked in the log.
"""

from enum import StrEnum

import numpy as np

from hal.base.arrays import Array
from rtstack.control.watch import TrialMonitor
from rtstack.loop.history import Columns
from rtstack.monitor.records import Reason, Verdict
from rtstack.trials.scoring import Bases, pad_forces, pad_places

ALONG_APPROACH = 0.8  # cosine: what stands in the way pushes against the motion
AHEAD_S = 0.35  # a verdict that comes so long after the nominal impact is not of the impact
# from where a pad is to meet the object: what it meets further away is something else, however slowly it comes. Ours: a
# hand that grabs at 0.4 m/s goes so far in 0.35 s
AHEAD_M = 0.14
BEFORE_S = (0.012, 0.002)
FIRST_TOUCH_S = (0.005, 0.020)  # after the detection: the pad touches, and has not yet turned
CORNER_M = 0.03  # from the pad's centre: 50 mm is its edge, and a face that meets a face stays below half of that
VERTICAL = 2.0  # times the horizontal part: a weight, not a push
LASTING_S = (0.45, 0.6)  # after the verdict: a person has let go, a weight has not
LASTING_SHARE = 0.5


class Unexpected(StrEnum):
    """What was not as meant."""

    TOO_EARLY = "too early"
    TOO_LATE = "too late"
    WRONG_PLACE = "wrong place"
    ONE_SIDE = "one side only"
    MISSING = "object missing"
    TOO_HEAVY = "too heavy"
    TOO_LIGHT = "too light"
    TILTED = "surface tilted"
    PUSH = "another contact, such as a push"  # a force that is not the object's; whose it was is not known
    UNKNOWN = "unknown"


def classify(
    monitor: TrialMonitor, columns: Columns, bases: Bases, start_t_ns: int, way: Array, period_s: float
) -> Unexpected | None:
    """Return what an unexpected impact was, None where it was none. columns: the trial's samples from start_t_ns on;
    way (2, n, 3): where the pads are to go in the world, m, one place each period."""
    if monitor.verdict is not Verdict.UNEXPECTED:
        return None
    return _Case(monitor, columns, bases, start_t_ns, way, period_s).kind()


class _Case:
    def __init__(
        self, monitor: TrialMonitor, columns: Columns, bases: Bases, start_t_ns: int, way: Array, period_s: float
    ) -> None:
        self._monitor = monitor
        self._way, self._period_s = way, period_s
        self._t_s = (columns.arm[0]["t_ns"] - start_t_ns) * 1e-9
        self._force = pad_forces(columns, bases) - monitor.pair[0]["tare"][:, None, :]
        self._wrench = columns.arm["O_F_ext_hat_K"]  # along the axes of the bases: only its sizes count
        self._position = pad_places(columns, bases)
        self._first = [
            float(state["t_first_ns"]) * 1e-9 if state["impacts"] > 0 else None for state in monitor.arms
        ]  # by arm, s
        self._t_d = monitor.impact.t_d_s
        self._zeta = monitor.parameters.arm.time_s

    def kind(self) -> Unexpected:
        """Ask the rules."""
        reason = self._monitor.reason
        met = sum(first is not None for first in self._first)
        if reason is Reason.LOAD and met < 2:  # the object's weight was missed before its impact was
            return Unexpected.ONE_SIDE if met else Unexpected.MISSING
        if reason is not Reason.ONE_SIDE and self._nearer():
            return self._both_shifted()
        if reason is Reason.NO_IMPACT:
            return Unexpected.MISSING
        if reason is Reason.ONE_SIDE:
            return Unexpected.ONE_SIDE
        if reason is Reason.LOAD:
            return self._load()
        if reason is Reason.PAIR_TIME:
            return self._both_shifted()
        if reason in (Reason.TIME, Reason.CONFIGURATION, Reason.SPACING):
            return self._off_time()
        if reason in (Reason.ENVELOPE, Reason.STOPPED) and self._corner() > CORNER_M:
            return Unexpected.TILTED
        return Unexpected.UNKNOWN

    def _nearer(self) -> bool:
        """Whether both arms have met the object too early: its sides are not where they should be."""
        first = [f for f in self._first if f is not None]
        at_impact = 1e-9 * float(self._monitor.pair[0]["t_verdict_ns"]) < self._t_d + AHEAD_S
        early = len(first) == 2 and max(first) < self._t_d - self._monitor.parameters.later_s
        return at_impact and early and all(map(self._near, (0, 1), first))

    def _near(self, side: int, first_s: float) -> bool:
        """Whether a pad that meets something then may have met what it aims at."""
        then, aimed = (min(round(t_s / self._period_s), self._way.shape[1] - 1) for t_s in (first_s, self._t_d))
        return float(np.linalg.norm(self._way[side, then] - self._way[side, aimed])) < AHEAD_M

    def _off_time(self) -> Unexpected:
        """An impact too early, too late or somewhere else: of what was meant, or of something else."""
        side = max(int(self._monitor.pair[0]["side"]), 0)
        first = self._first[side]
        if first is None:
            return Unexpected.UNKNOWN
        early = first - self._t_d
        verdict_s = 1e-9 * float(self._monitor.pair[0]["t_verdict_ns"])  # of the tick of the impact in question
        met = all(f is not None and abs(f - self._t_d) <= self._zeta and f < verdict_s for f in self._first)
        if met or (early < 0.0 and not (self._near(side, first) and self._against_approach(side, first))):
            return Unexpected.PUSH  # after both had met the object, or where it cannot be
        other = self._first[1 - side]
        if other is not None and (other - self._t_d) * early > 0.0 and abs(other - self._t_d) > self._zeta:
            return Unexpected.TOO_EARLY if early < 0.0 else Unexpected.TOO_LATE
        return Unexpected.WRONG_PLACE

    def _against_approach(self, side: int, first_s: float) -> bool:
        """Whether the pad pushes something along its own way. The measured one: the reference changes at the impact."""
        before = self._window(first_s - BEFORE_S[0], first_s - BEFORE_S[1])
        velocity = self._position[side, before.stop - 1] - self._position[side, before.start]
        touch = self._force[side, self._window(first_s + FIRST_TOUCH_S[0], first_s + FIRST_TOUCH_S[1])]
        if not len(touch):
            return False  # the run ended with the impact
        force = touch.mean(axis=0)
        size = float(np.linalg.norm(force) * np.linalg.norm(velocity))
        return size > 0.0 and float(force @ velocity) > ALONG_APPROACH * size

    def _both_shifted(self) -> Unexpected:
        """The later arm has hit too early: a face that is tilted is met at an edge, by both arms; else it is nearer."""
        if max(first for first in self._first if first is not None) > self._t_d:
            return Unexpected.TOO_LATE
        return Unexpected.TILTED if self._corner() > CORNER_M else Unexpected.TOO_EARLY

    def _corner(self) -> float:
        """How far from the pads' centres they first touch, m: the smaller one of both."""
        arms = []
        for side, first in enumerate(self._first):
            if first is None:
                continue
            wrench = self._wrench[side, self._window(first + FIRST_TOUCH_S[0], first + FIRST_TOUCH_S[1])]
            if not len(wrench):
                continue  # the run ended with the impact
            force = np.maximum(np.linalg.norm(wrench[:, :3], axis=1), 1.0)
            arms.append(float(np.median(np.linalg.norm(wrench[:, 3:], axis=1) / force)))
        return min(arms, default=0.0)

    def _load(self) -> Unexpected:
        """Both pads feel more, or less, than they should: a weight pulls down and stays, a push does what it likes."""
        verdict_s = float(self._monitor.pair[0]["t_verdict_ns"]) * 1e-9
        now = self._net_error(verdict_s, verdict_s + 0.1)
        later = self._net_error(verdict_s + LASTING_S[0], verdict_s + LASTING_S[1])
        lasts = now is None or later is None or abs(later[2]) > LASTING_SHARE * abs(now[2])
        if now is not None and lasts and abs(now[2]) > VERTICAL * float(np.hypot(now[0], now[1])):
            return Unexpected.TOO_HEAVY if now[2] > 0.0 else Unexpected.TOO_LIGHT
        return Unexpected.PUSH

    def _net_error(self, begin_s: float, end_s: float) -> Array | None:
        """Mean of the net force's error (3,), N; None where the trial had ended."""
        k = self._window(begin_s, end_s)
        if k.stop >= len(self._t_s) or k.stop <= k.start:
            return None
        net = self._monitor.impact.net_force[k.start : k.stop]
        return (self._force[:, k].sum(axis=0)[: len(net)] - net).mean(axis=0)

    def _window(self, begin_s: float, end_s: float) -> slice:
        begin, end = np.searchsorted(self._t_s, (begin_s, end_s))
        return slice(int(begin), max(int(end), int(begin) + 1))
