"""The monitor's parameters from recorded good runs and one wanted sensitivity. Deterministic; the paper tunes by hand.

Every bound is the worst deviation of the good runs times the sensitivity s, found one after the other: first what
counts as an impact (9), where each joint's noise stays below its bound by s twice, since the others are taken at
impacts; then (10), (11) and the pair's; then the margin of the envelopes (17), with the delay (18) after which waiting
gains little; then the pads' net force. Window, decay, horizon and spacing are the paper's (Table 2).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from hal.base.arrays import Array
from rtstack.control.records import WORKSPACE
from rtstack.control.watch import FREE_AFTER_S, UNTIL_BEFORE_S, TrialMonitor
from rtstack.loop.history import Columns
from rtstack.monitor.expected import ExpectedImpact
from rtstack.monitor.monitor import Monitor
from rtstack.monitor.pair import TARE_FROM_NS, NetForceParameters, PairParameters
from rtstack.monitor.parameters import MonitorParameters
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE
from rtstack.trials.errors import TrialError
from rtstack.trials.scoring import Bases, pad_forces

PERIOD_S = 1e-3
WINDOW, DECAY_1_S, HORIZON_S, SPACING_S = 13, 19.0, 0.1, 0.1  # Table 2 of the collision-monitoring paper
DELAYS = range(5, 96, 5)  # ticks, candidates of m_c
ENOUGH = 1.25  # times the margin that the longest delay needs: waiting longer gains little
SETTLED_S = 0.1  # the observer has started
AROUND_S = 0.15  # the nominal impact: what a displacement of 30 mm and the impact itself take
NET_START_S, NET_END_S, NET_STEP_S = -0.2, 0.5, 0.02
NET_FLOOR_N = 0.5  # noise of the estimate
NET_AROUND = 2  # steps on each side: where the object stands decides when its impacts come
NET_PATIENCE = 5
WIDE, WIDE_RAD_S = 1e6, 1e3  # bounds that nothing meets
HELD_OUT = 3  # every third demonstration is kept for the check


@dataclass(frozen=True, slots=True)
class GoodRun:
    """A trial in which all was as meant. name: its log; columns from its first tick on; bases: where the arms stood."""

    name: str
    columns: Columns
    impact: ExpectedImpact
    bases: Bases

    @property
    def t_s(self) -> Array:
        """Time since the first tick (n,)."""
        t_ns = self.columns.arm[0]["t_ns"]
        return (t_ns - t_ns[0]) * 1e-9

    @property
    def force(self) -> Array:
        """Force of each pad on its surroundings (2, n, 3), N, along the world's axes."""
        return pad_forces(self.columns, self.bases)


@dataclass(frozen=True, slots=True)
class Check:
    """What a tuning does on runs that it has not seen. false_alarms: names of good runs with an unexpected verdict."""

    runs: int
    false_alarms: tuple[str, ...]
    smallest_margin: float


def tune(runs: Sequence[GoodRun], sensitivity: float) -> PairParameters:
    """Return the parameters. Raises TrialError where a run has no impact on one of its arms."""
    rates = sensitivity**2 * np.max([_quiet_rate(run) for run in runs], axis=0)
    wide = MonitorParameters(
        tuple(rates.tolist()), WINDOW, DELAYS[0], DECAY_1_S, WIDE, WIDE, HORIZON_S, WIDE_RAD_S, WIDE
    )
    times, later, distances = [], [], []
    for run in runs:
        firsts = []
        for side in range(2):
            hits = _impacts(run, side, rates)
            if len(hits) == 0:
                raise TrialError(f"{run.name}: no impact of the {('left', 'right')[side]} arm: is it a good run?")
            t_s, impact = run.t_s[hits], run.impact
            firsts.append(t_s[0])
            times.append(np.abs(t_s - impact.t_d_s).max())
            distances.append(np.linalg.norm(run.columns.arm[side]["q"][hits] - impact.q_d[side], axis=1).max())
        later.append(abs(max(firsts) - run.impact.t_d_s))
    delay, margin = _envelope(runs, wide)
    arm = replace(
        wide,
        delay=delay,
        velocity_rad_s=_rounded(sensitivity * margin),
        time_s=_rounded(sensitivity * max(times)),
        configuration_rad=_rounded(sensitivity * max(distances)),
        spacing_s=SPACING_S,
        residual_rate_nm_s=tuple(_rounded(rate) for rate in rates),
    )
    return PairParameters(arm, _rounded(sensitivity * max(later)), _net_force(runs, sensitivity))


def check(runs: Sequence[GoodRun], parameters: PairParameters) -> Check:
    """Let the monitor see runs that are good."""
    monitors = [replay(run, parameters) for run in runs]
    alarms = tuple(run.name for run, monitor in zip(runs, monitors, strict=True) if monitor.unexpected)
    return Check(len(runs), alarms, min((float(m.pair[0]["margin"]) for m in monitors), default=1.0))


def replay(run: GoodRun, parameters: PairParameters) -> TrialMonitor:
    """Let a fresh monitor see a recorded trial, tick by tick as in the loop. Returns it as it is at the end."""
    monitor = TrialMonitor(parameters, run.impact, PERIOD_S)
    arms, controls = run.columns.arm.view(np.uint8), run.columns.control.view(np.uint8)
    samples, written = np.zeros((2, 1), ARM_SAMPLE), np.zeros((2, 1), CONTROL_SAMPLE)
    work = np.zeros(1, WORKSPACE)
    sides = tuple(zip(samples, written, samples.view(np.uint8), written.view(np.uint8), strict=True))
    t_ns = run.columns.arm[0]["t_ns"] - run.columns.arm[0]["t_ns"][0]
    force = -run.force
    sample_size, control_size = ARM_SAMPLE.itemsize, CONTROL_SAMPLE.itemsize
    for k in range(len(t_ns)):
        for side, (sample, control, sample_bytes, control_bytes) in enumerate(sides):
            sample_bytes[:] = arms[side, k * sample_size : (k + 1) * sample_size]
            control_bytes[:] = controls[side, k * control_size : (k + 1) * control_size]
            work["force_world"][0] = force[side, k]
            monitor.step(side, sample, work, control, int(t_ns[k]))
    return monitor


def _rates(run: GoodRun) -> Array:
    """|(8)| of both arms (2, n, 7), Nm/s."""
    residual = run.columns.control["momentum_residual"]
    return np.abs(np.diff(residual, axis=1, prepend=residual[:, :1])) / PERIOD_S


def _quiet_rate(run: GoodRun) -> Array:
    """Largest rate (7,) of the residual where nothing is hit: before the impact, and while the object is carried."""
    t_s, t_d = run.t_s, run.impact.t_d_s
    quiet = (t_s > SETTLED_S) & (np.abs(t_s - t_d) > AROUND_S) & (t_s < run.impact.set_down_s)
    return _rates(run)[:, quiet].max(axis=(0, 1))


def _impacts(run: GoodRun, side: int, bounds: Array) -> NDArray[np.int64]:
    """Ticks of (9) until the object is set down."""
    above = _rates(run)[side] >= bounds
    before = np.concatenate([above[:1], above[:-1]])
    return np.flatnonzero((above & ~before).any(axis=1) & (run.t_s < run.impact.set_down_s))


def _envelope(runs: Sequence[GoodRun], wide: MonitorParameters) -> tuple[int, float]:
    """Return the delay m_c, ticks, and the margin e_m, rad/s, with which (17) is met by every run."""
    needed = [max(_violation(run, side, replace(wide, delay=d)) for run in runs for side in range(2)) for d in DELAYS]
    best = next(k for k, margin in enumerate(needed) if margin <= ENOUGH * needed[-1])
    return DELAYS[best], needed[best]


def _violation(run: GoodRun, side: int, wide: MonitorParameters) -> float:
    """How far zero lies outside the envelopes, rad/s."""
    arm, impact = run.columns.arm[side], run.impact
    n = min(len(arm), impact.dq_post.shape[1], round(impact.set_down_s / PERIOD_S))
    monitor = Monitor(wide)
    monitor.expect(round(impact.t_d_s * 1e9), impact.q_d[side])
    residual = run.columns.control[side]["momentum_residual"][:n]
    t_ns = arm["t_ns"][:n] - arm["t_ns"][0]
    arrays = (residual, arm["q"][:n], arm["dq"][:n], impact.dq_post[side, :n])
    return WIDE_RAD_S * max(0.0, 1.0 - monitor.assess(t_ns, *map(np.ascontiguousarray, arrays)).margin)


def _net_force(runs: Sequence[GoodRun], sensitivity: float) -> NetForceParameters:
    """Bounds from the largest error of every step and its neighbours: impacts come earlier or later with the object."""
    steps = round((NET_END_S - NET_START_S) / NET_STEP_S) + 1
    largest = np.zeros((steps, 3))
    for run in runs:
        t_s, impact = run.t_s, run.impact
        free = (t_s > TARE_FROM_NS * 1e-9) & (t_s < impact.t_d_s - UNTIL_BEFORE_S)
        force = run.force - run.force[:, free].mean(axis=1)[:, None]
        n = min(len(t_s), len(impact.net_force))
        error = np.abs(force.sum(axis=0)[:n] - impact.net_force[:n])
        seen = (t_s < impact.set_down_s) | (t_s >= impact.release_s + FREE_AFTER_S)
        seen &= t_s > TARE_FROM_NS * 1e-9 + SETTLED_S
        step = np.floor((t_s - impact.t_d_s - NET_START_S) / NET_STEP_S + 1e-9)
        step = np.clip(step, 0, steps - 1).astype(np.int64)
        np.maximum.at(largest, step[:n][seen[:n]], error[seen[:n]])
    around = maximum_filter1d(largest, 2 * NET_AROUND + 1, axis=0, mode="nearest")
    around[[0, -1]] = largest[[0, -1]]  # the first and the last one count for ever
    bounds = [[_rounded(value) for value in axis] for axis in (sensitivity * around + NET_FLOOR_N).T]
    x, y, z = map(tuple, bounds)
    return NetForceParameters(NET_START_S, NET_STEP_S, x, y, z, NET_PATIENCE)


def _rounded(value: float) -> float:
    """Three digits: what is behind them is of these runs, not of the next ones."""
    return float(f"{value:.3g}")
