"""The monitor once more, in plain Python from the paper's equations: the oracle of the compiled one.

It keeps every sample and looks back at them where the compiled one keeps a ring; the two share no code.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from rtstack.monitor.parameters import MonitorParameters


@dataclass(slots=True)
class PlainMonitor:
    """Algorithm 1 as the paper words it, with the resolutions that step.py names."""

    parameters: MonitorParameters
    t_d_ns: int
    q_d: Sequence[float]
    t: list[int] = field(default_factory=list)
    r: list[list[float]] = field(default_factory=list)
    e_vel: list[list[float]] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    impacts: list[int] = field(default_factory=list)  # k_j
    unmet: list[str] = field(default_factory=list)  # of (10)-(12), in the order of the impacts
    window: str = "off"  # Post-Impact
    verdict: str = "none"
    reason: str = "none"

    def update(self, t_ns: int, r: Sequence[float], q: Sequence[float], dq: Sequence[float], ref: Sequence[float]):
        """Take a tick."""
        self.t.append(t_ns)
        self.r.append(list(r))
        self.e_vel.append([a - b for a, b in zip(dq, ref, strict=True)])
        k, p = len(self.t) - 1, self.parameters
        hit = any(
            self._rate(k, i) >= bound and self._rate(k - 1, i) < bound for i, bound in enumerate(p.residual_rate_nm_s)
        )
        if hit:
            self.impacts.append(k)
            self.lower, self.upper = list(self.e_vel[k]), list(self.e_vel[k])
        elif self.impacts:
            self._filter(k)
        if self.verdict == "unexpected":
            return
        if hit:
            self._at_impact(q)
        self._after(t_ns)

    def _rate(self, k: int, i: int) -> float:
        """|(8)|, zero where there is no tick before."""
        return abs((self.r[k][i] - self.r[k - 1][i]) / ((self.t[k] - self.t[k - 1]) * 1e-9)) if k > 0 else 0.0

    def _filter(self, k: int) -> None:
        m = min(self.parameters.window, k - self.impacts[-1])
        a_dt = min(1.0, self.parameters.decay_1_s * (self.t[k] - self.t[k - 1]) * 1e-9)
        for i in range(len(self.lower)):
            x = [sample[i] for sample in self.e_vel[k - m : k + 1]]
            self.lower[i] = min(min(x), (1.0 - a_dt) * self.lower[i] + a_dt * min(x))
            self.upper[i] = max(max(x), (1.0 - a_dt) * self.upper[i] + a_dt * max(x))

    def _at_impact(self, q: Sequence[float]) -> None:
        p, t = self.parameters, [self.t[k] for k in self.impacts]
        distance = math.sqrt(sum((a - b) ** 2 for a, b in zip(q, self.q_d, strict=True)))
        if abs(t[-1] - self.t_d_ns) > round(p.time_s * 1e9):
            self.unmet.append("time")
        elif distance / p.configuration_rad > 1.0:
            self.unmet.append("configuration")
        elif len(t) > 1 and t[-1] - t[-2] > round(p.spacing_s * 1e9):
            self.unmet.append("spacing")
        self.window = "unexpected" if self.unmet else "unknown"
        self.reason = self.unmet[0] if self.unmet else "none"

    def _after(self, t_ns: int) -> None:
        p = self.parameters
        if not self.impacts:
            if t_ns - self.t_d_ns > round(p.time_s * 1e9):
                self.verdict, self.reason = "unexpected", "no_impact"
            return
        since = t_ns - self.t[self.impacts[-1]]
        if self.window == "unknown":
            met = all(
                low / p.velocity_rad_s <= 1.0 and high / p.velocity_rad_s >= -1.0
                for low, high in zip(self.lower, self.upper, strict=True)
            )
            if not met and since >= round(p.delay * p.period_s * 1e9):
                self.window, self.reason = "unexpected", "envelope"
            elif since > round(p.horizon_s * 1e9):
                self.window = "expected"
        if self.window in ("expected", "unexpected") and since > round(p.horizon_s * 1e9):
            self.verdict = "expected" if self.window == "expected" and not self.unmet else "unexpected"
