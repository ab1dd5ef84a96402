"""Both arms' monitors as one: was the grab the one that was meant? Compiled; `watch.py` of rtstack.control feeds it.

Beyond the paper: one arm's verdict says nothing about the other arm, nor about what is in between. The pair's is
unexpected as soon as nothing can make it expected any more, and expected once both arms' are and the object has been
carried for a moment as the reference has it: both pads together carry its weight and inertia, and nothing else.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hal.compilation import compiled, fields
from rtstack.monitor.parameters import MonitorParameters
from rtstack.monitor.records import Reason, Verdict
from rtstack.monitor.step import monitor_expect, monitor_step

_NONE, _EXPECTED, _UNEXPECTED = int(Verdict.NONE), int(Verdict.EXPECTED), int(Verdict.UNEXPECTED)
_NO_REASON, _NO_IMPACT = int(Reason.NONE), int(Reason.NO_IMPACT)
_ONE_SIDE, _LOAD, _PAIR_TIME = int(Reason.ONE_SIDE), int(Reason.LOAD), int(Reason.PAIR_TIME)
BOTH = -1
TARE, IMPACT, AFTER = 0, 1, 2  # nothing can be touched yet; impact and carrying; all is over, only the net force counts
TARE_FROM_NS = 100_000_000  # observers and filters have settled; from then to before the impact a pad feels nothing

# side: 0 left, 1 right, -1 both or neither; t_verdict_ns: when it came. force: of each pad on its surroundings; tare:
# what the estimate shows where nothing is touched, N; error: of the net force. over: ticks in a row out of bounds;
# time_margin: of the later arm's first impact
PAIR = np.dtype(
    [
        *fields("i8", "verdict reason side"),
        ("margin", "f8"),
        ("t_verdict_ns", "i8"),
        *fields("f8", "force tare", 2, 3),
        ("tared", "i8", 2),
        ("error", "f8", 3),
        ("over", "i8"),
        ("time_margin", "f8"),
    ]
)
# period_ns: of the tick; decided_ns: before it no grab is expected; later_ns, patience: as in the parameters below
TIMES = np.dtype(fields("i8", "period_ns decided_ns later_ns patience"))


def expected_dtype(joints: int) -> np.dtype:
    """Return the record of what a tick of the reference expects.

    dq: joint velocities (14) of both arms after the impact, rad/s; net_force: of both pads on their surroundings, N;
    bound: how far it may be off, N, infinite where nothing is known. phase: TARE, IMPACT or AFTER.
    """
    return np.dtype([("dq", "f8", (2, joints)), ("net_force", "f8", 3), ("bound", "f8", 3), ("phase", "i8")])


@dataclass(frozen=True, slots=True)
class NetForceParameters:
    """How far the net force of both pads may be from the reference's, N, along the world's x, y and z.

    A bound every step_s: the first until start_s (from the nominal impact), the last one from the end on. patience:
    ticks in a row that it has to be exceeded.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    start_s: float
    step_s: float
    x_n: tuple[float, ...]
    y_n: tuple[float, ...]
    z_n: tuple[float, ...]
    patience: int

    def __post_init__(self) -> None:
        if not (math.isfinite(self.start_s) and math.isfinite(self.step_s) and self.step_s > 0.0):
            raise ValueError("start_s and step_s have to be numbers, step_s a positive one")
        if not len(self.x_n) == len(self.y_n) == len(self.z_n) > 0:
            raise ValueError("x_n, y_n and z_n need as many bounds as each other, and at least one")
        if not all(bound > 0.0 for bound in (*self.x_n, *self.y_n, *self.z_n)):
            raise ValueError("x_n, y_n and z_n have to be positive")
        if self.patience < 1:
            raise ValueError(f"patience has to be at least 1 tick, not {self.patience}")

    @property
    def end_s(self) -> float:
        """Time after the nominal impact from which on the last bound counts."""
        return self.start_s + self.step_s * (len(self.x_n) - 1)

    def bounds(self, since_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the bounds (n, 3) at these times (n,) after the nominal impact."""
        # not int() of a quotient that rounding may leave just below a whole number
        steps = np.clip(np.floor((since_s - self.start_s) / self.step_s + 1e-9), 0, len(self.x_n) - 1).astype(np.int64)
        return np.array([self.x_n, self.y_n, self.z_n]).T[steps]


@dataclass(frozen=True, slots=True)
class PairParameters:
    """The tuning of a grab's monitor: of Algorithm 1, for both arms, and of what concerns both together.

    later_s: how far from the nominal time the later arm's first impact may be. A displaced object meets one arm early
    and, since that one waits for the other, the other one nearly on time; one that is wider meets both early.
    """

    __pydantic_config__: ClassVar[dict[str, str]] = {"extra": "forbid"}

    arm: MonitorParameters
    later_s: float
    net_force: NetForceParameters

    def __post_init__(self) -> None:
        if not (math.isfinite(self.later_s) and self.later_s > 0.0):
            raise ValueError(f"later_s has to be a positive number, not {self.later_s}")


@compiled
def pair_expect(pairs, states, t_d_ns, q_d):
    """Begin anew with both arms: one impact at t_d_ns, in the configurations q_d (2, n)."""
    pair = pairs[0]
    pair.verdict = _NONE
    pair.reason = _NO_REASON
    pair.side = BOTH
    pair.margin = 1.0
    pair.time_margin = 1.0
    pair.t_verdict_ns = 0
    pair.over = 0
    for k in range(2):
        pair.tared[k] = 0
        for i in range(3):
            pair.tare[k, i] = pair.force[k, i] = 0.0
        monitor_expect(states[k : k + 1], t_d_ns, q_d[k])


@compiled
def pair_step(pairs, states, side, parameters, times, expected, sample, residual, force, t_ns):
    """Take a tick of one arm into pairs[0] and states[side], (1,) of PAIR and (2,) of monitor_dtype.

    parameters, residual: see monitor_step. times: a record of TIMES; expected: this tick's, of expected_dtype; sample:
    with the measured q and dq. force (3,) N: of this pad on its surroundings. Times count from the reference's start.
    """
    pair = pairs[0]
    phase = expected.phase
    if phase != AFTER and pair.verdict != _EXPECTED:
        monitor_step(states[side : side + 1], parameters, t_ns, residual, sample.q, sample.dq, expected.dq[side])
    margin = _net_force(pair, side, t_ns, force, expected.net_force, expected.bound, phase)
    if pair.verdict == _UNEXPECTED:
        return
    if phase == IMPACT and states[0].impacts > 0 and states[1].impacts > 0:
        later = max(states[0].t_first_ns, states[1].t_first_ns)
        pair.time_margin = 1.0 - abs(later - states[0].t_d_ns) / times.later_ns
    pair.margin = min(margin, pair.time_margin, states[0].margin, states[1].margin)
    pair.over = pair.over + 1 if margin < 0.0 else 0
    if pair.over > 2 * times.patience:  # both arms count
        _decide(pair, t_ns, _UNEXPECTED, _LOAD, BOTH)
    elif pair.verdict == _NONE:
        if pair.time_margin < 0.0:
            _decide(pair, t_ns, _UNEXPECTED, _PAIR_TIME, BOTH)
            return
        for k in range(2):
            if states[k].verdict == _UNEXPECTED or states[k].instantaneous == _UNEXPECTED:
                alone = states[k].reason == _NO_IMPACT and states[1 - k].impacts > 0
                _decide(pair, t_ns, _UNEXPECTED, _ONE_SIDE if alone else states[k].reason, k)
                return
        if states[0].verdict == _EXPECTED and states[1].verdict == _EXPECTED and t_ns >= times.decided_ns:
            _decide(pair, t_ns, _EXPECTED, _NO_REASON, BOTH)


@compiled
def _decide(pair, t_ns, verdict, reason, side):
    pair.verdict = verdict
    pair.reason = reason
    pair.side = side
    pair.t_verdict_ns = t_ns


@compiled
def _net_force(pair, side, t_ns, force, net_ref, bound, phase):
    """Return the margin of the net force: 1 where it is the reference's, 0 at the bound."""
    if phase == TARE and t_ns >= TARE_FROM_NS:
        pair.tared[side] += 1
        for i in range(3):
            pair.tare[side, i] += (force[i] - pair.tare[side, i]) / pair.tared[side]
    margin = 1.0
    for i in range(3):
        pair.force[side, i] = force[i] - pair.tare[side, i]
        pair.error[i] = pair.force[0, i] + pair.force[1, i] - net_ref[i]
        if pair.tared[0] > 0 and pair.tared[1] > 0:
            margin = min(margin, 1.0 - abs(pair.error[i]) / bound[i])
    return margin
