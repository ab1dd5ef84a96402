"""The aim-aware monitor in the tick: both arms' residuals against the impact that the reference aims at."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hal.compilation import bound, compiled
from rtstack.monitor.expected import ExpectedImpact
from rtstack.monitor.pair import (
    AFTER,
    IMPACT,
    PAIR,
    TARE,
    TIMES,
    PairParameters,
    expected_dtype,
    pair_expect,
    pair_step,
)
from rtstack.monitor.records import Reason, Verdict, monitor_dtype

FREE_AFTER_S = 0.4  # after the release the pads have let go, and feel nothing again
_UNEXPECTED = int(Verdict.UNEXPECTED)
UNTIL_BEFORE_S = 0.2  # the nominal impact: where an object that is displaced cannot be met yet


class TrialMonitor:
    """Watches one trial. `pair` (1,) of PAIR and `arms` (2,) of monitor_dtype(7) are what is known so far."""

    def __init__(self, parameters: PairParameters, impact: ExpectedImpact, period_s: float) -> None:
        """Copies everything that the tick needs, so that it makes one specialisation of compiled code."""
        self.parameters = parameters
        self.impact = impact
        self.pair = np.zeros(1, PAIR)
        self.arms = np.zeros(2, monitor_dtype(parameters.arm.joints))
        self._record = parameters.arm.record()
        self._times = np.zeros(1, TIMES)
        self._times["period_ns"] = round(period_s * 1e9)
        self._times["decided_ns"] = round((impact.t_d_s + parameters.net_force.end_s) * 1e9)
        self._times["later_ns"] = round(parameters.later_s * 1e9)
        self._times["patience"] = parameters.net_force.patience
        self._expected = np.zeros(len(impact.net_force), expected_dtype(parameters.arm.joints))
        self._expected["dq"] = np.swapaxes(impact.dq_post, 0, 1)
        self._expected["net_force"] = impact.net_force
        self._expected["bound"] = self._net_bounds(period_s)
        self._expected["phase"] = AFTER
        self._expected["phase"][: round(impact.set_down_s / period_s)] = IMPACT
        self._expected["phase"][: max(0, round((impact.t_d_s - UNTIL_BEFORE_S) / period_s))] = TARE
        # a number of numpy's own costs more to make, and to compare, than Python's
        self._verdict, self._reason = self.pair["verdict"].data, self.pair["reason"]
        self._said = int(Verdict.NONE)
        self._watched: list[NDArray | None] = [None, None]
        # of each arm: take the tick that it has just observed, so long after the start; see `bind`
        self.watch: list[Callable[[int], None]] = [lambda _elapsed_ns: None] * 2
        pair_expect(self.pair, self.arms, round(impact.t_d_s * 1e9), np.array(impact.q_d, dtype=np.float64))

    def _net_bounds(self, period_s: float) -> np.ndarray:
        """The bounds (n, 3) of every tick: none from where the object may meet the table until nothing is held."""
        t_s = np.arange(len(self._expected)) * period_s
        bounds = self.parameters.net_force.bounds(np.asarray(t_s - self.impact.t_d_s, dtype=np.float64))
        bounds[(t_s >= self.impact.set_down_s) & (t_s < self.impact.release_s + FREE_AFTER_S)] = math.inf
        return bounds

    def step(self, side: int, sample: NDArray, workspace: NDArray, control: NDArray, elapsed_ns: int) -> None:
        """Take the tick of any arm, so long after the start, and write what its log keeps."""
        if sample is not self._watched[side]:
            self.bind(side, sample, workspace, control)
        self.watch[side](elapsed_ns)

    def bind(self, side: int, sample: NDArray, workspace: NDArray, control: NDArray) -> None:
        """Look up where an arm's records (1,) are, before a clock runs: a loop shows the same ones every tick."""
        self._watched[side] = sample
        self.watch[side] = bound(
            watch,
            self.pair, self.arms, side, self._record, self._times, self._expected, sample, workspace, control,
            later=(0,),
        )  # fmt: skip

    @property
    def unexpected(self) -> bool:
        """Whether the impact was another one than was meant."""
        return self._verdict[0] == _UNEXPECTED

    @property
    def verdict(self) -> Verdict:
        """What is known by now."""
        return Verdict(self._verdict[0])

    @property
    def reason(self) -> Reason:
        """Why it is unexpected."""
        return Reason(self._reason[0])

    def since_contact_s(self, t_s: float) -> float:
        """Time since the first impact of either arm; negative where there was none."""
        hit = self.arms["impacts"] > 0
        return t_s - 1e-9 * float(self.arms["t_first_ns"][hit].min()) if hit.any() else -1.0

    @property
    def crash(self) -> bool:
        """Whether an impact occurred where or when none was planned; it may have been a person."""
        hit_at_all = bool(self.arms["impacts"].any())
        return self.unexpected and hit_at_all and self.reason in (Reason.TIME, Reason.CONFIGURATION, Reason.SPACING)

    def stopped_by_fault(self) -> None:
        """Judge a trial that a fault has ended: an impact that the arms did not survive was not meant."""
        if self.verdict is Verdict.NONE and self.arms["impacts"].any():
            last_ns = int(max(self.arms["t_ns"]))
            self.pair["verdict"], self.pair["reason"] = Verdict.UNEXPECTED, Reason.STOPPED
            self.pair["t_verdict_ns"] = last_ns

    def news(self) -> bool:
        """Whether the verdict is another one than at the last call."""
        verdict = self._verdict[0]
        changed, self._said = verdict != self._said, verdict
        return changed

    @property
    def text(self) -> str:
        """The verdict in one line. Not for the tick."""
        pair = self.pair[0]
        if self.verdict is not Verdict.UNEXPECTED:
            return f"{self.verdict.name.lower()}, margin {pair['margin']:.2f}"
        where = ("left: ", "right: ", "")[pair["side"]]
        return f"unexpected: {where}{self.reason.name.lower().replace('_', ' ')}, margin {pair['margin']:.2f}"


@compiled
def watch(pairs, states, side, parameters, times, expected, samples, workspaces, controls, t_ns):
    """Let the pair's monitor see one arm's tick; write verdict, reason and margin into its control record.

    pairs to parameters: see pair_step. times (1,) of TIMES, expected (n,) of expected_dtype; samples, workspaces and
    controls (1,): of this arm.
    """
    work, control = workspaces[0], controls[0]
    now = expected[min(t_ns // times[0].period_ns, expected.shape[0] - 1)]
    pair = pairs[0]
    if now.phase != AFTER or now.bound[0] < math.inf:
        for i in range(3):
            work.three[i] = -work.force_world[i]
        pair_step(
            pairs, states, side, parameters, times[0], now, samples[0], control.momentum_residual, work.three, t_ns
        )  # fmt: skip
    state = states[side]
    control.impact_verdict = state.verdict
    control.impact_reason = state.reason
    control.impact_margin = state.margin
    control.pair_verdict = pair.verdict
    control.pair_reason = pair.reason
    control.pair_margin = pair.margin
