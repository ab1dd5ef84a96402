"""The monitor's parameters from recorded good motions of any robot and one wanted sensitivity. Deterministic.

Every bound is the worst deviation of the good motions times the sensitivity s, found one after the other: first what
counts as an impact (9), where each joint's noise stays below its bound by s twice, since the others are taken at
impacts; then (10) and (11); then the margin of the envelopes (17), with the delay (18) after which waiting gains
little. Window, decay, horizon and spacing are the collision-monitoring paper's (Table 2): they depend on how a robot
vibrates after an impact, and may be replaced.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import numbers
from rtstack.monitor.monitor import SIGNALS, Monitor, checked_signals
from rtstack.monitor.parameters import MonitorParameters

Array = NDArray[np.floating]

WINDOW_S, DECAY_1_S, HORIZON_S, SPACING_S = 0.013, 19.0, 0.1, 0.1  # Table 2 of the collision-monitoring paper
DELAYS_S = np.arange(5, 96, 5) * 1e-3  # candidates of m_c
SHORTEST_S, LONGEST_S = 0.00022, 0.005  # of a tick: the window holds at most 63, the first delay at least one
ENOUGH = 1.25  # times the margin that the longest delay needs: waiting longer gains little
SETTLED_S = 0.1  # the observer has started
AROUND_S = 0.15  # the nominal impact: what a displacement of 30 mm and the impact itself take
LARGEST = 100.0  # sensitivity
WIDE, WIDE_RAD_S = 1e6, 1e3  # bounds that nothing meets


@dataclass(frozen=True, slots=True)
class GoodMotion:
    """A recorded motion of one arm of n joints whose impact was the one that was meant; it ends before another one.

    Attributes:
        name: For messages.
        t_ns: Times (ticks,), whole ns, increasing.
        residual: Estimate of the external joint torques (ticks, n) Nm.
        q, dq: Measured (ticks, n) rad, rad/s.
        dq_ref: Reference of dq after the impact (ticks, n) rad/s.
        t_d_ns: When the impact was meant to be, ns.
        q_d: In which configuration it was meant to be (n,) rad.
    """

    name: str
    t_ns: NDArray[np.int64]
    residual: Array
    q: Array
    dq: Array
    dq_ref: Array
    t_d_ns: int
    q_d: Array

    def __post_init__(self) -> None:
        """Raise ValueError, with one line, for arrays that do not fit."""
        q_d, t_d_ns = numbers(self.q_d, "q_d", (None,)), int(numbers(self.t_d_ns, "t_d_ns", (), np.int64))
        signals = checked_signals(len(q_d), self.t_ns, self.residual, self.q, self.dq, self.dq_ref, finite=True)
        for name, value in zip(("t_ns", *SIGNALS, "t_d_ns", "q_d"), (*signals, t_d_ns, q_d), strict=True):
            object.__setattr__(self, name, value)

    @property
    def after_s(self) -> Array:
        """Return the time since the nominal impact (ticks,) s."""
        return (self.t_ns - self.t_ns[:1]) * 1e-9 - (self.t_d_ns - self.t_ns[:1]) * 1e-9

    def rates(self) -> Array:
        """Return |(8)| (ticks, n) Nm/s."""
        steps = np.abs(np.diff(self.residual, axis=0, prepend=self.residual[:1]))
        return steps / (np.diff(self.t_ns, prepend=self.t_ns[:1] - 1) * 1e-9)[:, None]

    def quiet_rates(self) -> Array:
        """Return the largest rate of each joint where nothing is hit (n,) Nm/s."""
        quiet = ((self.t_ns - self.t_ns[:1]) * 1e-9 > SETTLED_S) & (np.abs(self.after_s) > AROUND_S)
        if not quiet.any():
            raise ValueError(f"{self.name}: expected more than {AROUND_S} s without an impact")
        return self.rates()[quiet].max(axis=0)

    def impacts(self, bounds: Array) -> NDArray[np.int64]:
        """Return the ticks of (9) for the bounds (n,) Nm/s. Raises ValueError where there is none."""
        above = self.rates() >= bounds
        before = np.concatenate([above[:1], above[:-1]])
        hits = np.flatnonzero((above & ~before).any(axis=1))
        if len(hits) == 0:
            raise ValueError(f"{self.name}: no impact: is it a good run?")
        return hits

    def violation(self, wide: MonitorParameters) -> float:
        """Return how far zero lies outside the envelopes, rad/s."""
        monitor = Monitor(wide)
        monitor.expect(self.t_d_ns, self.q_d)
        found = monitor.assess(self.t_ns, self.residual, self.q, self.dq, self.dq_ref)
        return WIDE_RAD_S * max(0.0, 1.0 - found.margin)


@np.errstate(over="ignore")  # an infinite bound is refused
def tune_monitor(motions: Sequence[GoodMotion], sensitivity: float) -> MonitorParameters:
    """Return the parameters with which every good motion is expected.

    Args:
        motions: Of one robot and one task, better ten than two; the more they differ, the wider are the bounds. Window
            and delay are counted in ticks of the first one.
        sensitivity: How many times the worst good motion's deviation is unexpected, at least 1. 1.5 is what the
            tunings that come with rtstack have.

    Raises:
        ValueError: One line that names the motion, such as one without an impact.
        TypeError: Motions of another kind.
    """
    rates = impact_rates(motions, sensitivity)
    period_s = float(np.median(np.diff(motions[0].t_ns))) * 1e-9
    if not SHORTEST_S <= period_s <= LONGEST_S:
        raise ValueError(f"t_ns: expected ticks of {SHORTEST_S} to {LONGEST_S} s, found {period_s:.3g} s")
    window, delays = round(WINDOW_S / period_s), np.round(DELAYS_S / period_s).astype(int).tolist()
    wide = MonitorParameters(
        tuple(rates.tolist()), window, delays[0], DECAY_1_S, WIDE, WIDE, HORIZON_S, WIDE_RAD_S, WIDE, period_s
    )
    times, distances = [], []
    for motion in motions:
        hits = motion.impacts(rates)
        times.append(np.abs(motion.after_s[hits]).max())
        distances.append(np.linalg.norm(motion.q[hits] - motion.q_d, axis=1).max())
    needed = [max(motion.violation(replace(wide, delay=delay)) for motion in motions) for delay in delays]
    best = next(k for k, margin in enumerate(needed) if margin <= ENOUGH * needed[-1])
    return replace(
        wide,
        delay=delays[best],
        velocity_rad_s=rounded(sensitivity * needed[best]),
        time_s=rounded(sensitivity * max(times)),
        configuration_rad=rounded(sensitivity * max(distances)),
        spacing_s=SPACING_S,
        residual_rate_nm_s=tuple(rounded(rate) for rate in rates),
    )


def impact_rates(motions: Sequence[GoodMotion], sensitivity: float) -> Array:
    """Return the rates (n,) Nm/s from which on a residual is an impact, before they are rounded: see `tune_monitor`."""
    sensitivity = float(numbers(sensitivity, "sensitivity", ()))
    if not motions or not 1.0 <= sensitivity <= LARGEST:
        raise ValueError(f"expected motions and a sensitivity of 1 to {LARGEST}, found {len(motions)}, {sensitivity}")
    for motion in motions:
        if not isinstance(motion, GoodMotion):
            raise TypeError(f"motions: expected GoodMotion, found {type(motion).__name__}")
        if motion.q.shape[1] != motions[0].q.shape[1]:
            raise ValueError(f"{motion.name}: expected {motions[0].q.shape[1]} joints, found {motion.q.shape[1]}")
    return sensitivity**2 * np.max([motion.quiet_rates() for motion in motions], axis=0)


def rounded(value: float) -> float:
    """Return three digits: what is behind them is of these runs, not of the next ones."""
    return float(f"{value:.3g}")
