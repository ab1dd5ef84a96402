"""The monitor's parameters from recorded good runs and one wanted sensitivity. Deterministic; the paper tunes by hand.

Each arm's are those of its motions up to where the object is set down (rtstack.monitor.tuning). Of both arms together
are the later one's first impact, and the pads' net force: the worst deviation of the good runs times the sensitivity.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from scipy.ndimage import maximum_filter1d

from hal.base.arrays import Array
from rtstack.control.records import WORKSPACE
from rtstack.control.watch import FREE_AFTER_S, UNTIL_BEFORE_S, TrialMonitor
from rtstack.loop.history import Columns
from rtstack.monitor.expected import ExpectedImpact
from rtstack.monitor.pair import TARE_FROM_NS, NetForceParameters, PairParameters
from rtstack.monitor.tuning import SETTLED_S, GoodMotion, impact_rates, rounded, tune_monitor
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, SIDES
from rtstack.trials.errors import TrialError
from rtstack.trials.scoring import Bases, pad_forces

PERIOD_S = 1e-3
NET_START_S, NET_END_S, NET_STEP_S = -0.2, 0.5, 0.02
NET_FLOOR_N = 0.5  # noise of the estimate
NET_AROUND = 2  # steps on each side: where the object stands decides when its impacts come
NET_PATIENCE = 5
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

    def motion(self, side: int) -> GoodMotion:
        """Return what one arm's monitor sees of it."""
        arm, impact = self.columns.arm[side], self.impact
        n = min(len(arm), impact.dq_post.shape[1], round(impact.set_down_s / PERIOD_S))
        residual = self.columns.control[side]["momentum_residual"][:n]
        signals = (residual, arm["q"][:n], arm["dq"][:n], impact.dq_post[side, :n])
        name, t_ns = f"{self.name}, {SIDES[side]} arm", arm["t_ns"][:n] - arm["t_ns"][0]
        return GoodMotion(name, t_ns, *signals, round(impact.t_d_s * 1e9), impact.q_d[side])


@dataclass(frozen=True, slots=True)
class Check:
    """What a tuning does on runs that it has not seen. false_alarms: names of good runs with an unexpected verdict."""

    runs: int
    false_alarms: tuple[str, ...]
    smallest_margin: float


def tune(runs: Sequence[GoodRun], sensitivity: float) -> PairParameters:
    """Return the parameters. Raises TrialError where a run has no impact on one of its arms."""
    try:
        pairs = [[run.motion(side) for side in range(2)] for run in runs]
        motions = list(chain.from_iterable(pairs))
        arm, rates = tune_monitor(motions, sensitivity), impact_rates(motions, sensitivity)
    except ValueError as error:
        raise TrialError(str(error)) from None
    later = [abs(max(float(each.after_s[each.impacts(rates)[0]]) for each in pair)) for pair in pairs]
    return PairParameters(arm, rounded(sensitivity * max(later)), _net_force(runs, sensitivity))


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
    bounds = [[rounded(value) for value in axis] for axis in (sensitivity * around + NET_FLOOR_N).T]
    x, y, z = map(tuple, bounds)
    return NetForceParameters(NET_START_S, NET_STEP_S, x, y, z, NET_PATIENCE)
