"""One case: simulated once, then seen by every tuning."""

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from rtstack.monitor.monitor import Assessment, Monitor
from rtstack.monitor.parameters import MonitorParameters
from rtstack.papers.aim_aware.outline import Case
from rtstack.papers.aim_aware.planar.plan import Meant, Plan, plan_impact
from rtstack.papers.aim_aware.planar.simulation import simulate
from rtstack.papers.aim_aware.study import Study

P = TypeVar("P", bound=Meant[Any], covariant=True)


@dataclass(frozen=True, slots=True)
class Impact(Generic[P]):
    """A planned impact on a surface that is inclined otherwise. ticks: of TICK, of a simulation or of a hit."""

    case: Case
    plan: P
    ticks: NDArray[np.void]

    @property
    def t_d_ns(self) -> int:
        return round(self.plan.t_d_s * 1e9)

    def trace(self, parameters: MonitorParameters) -> NDArray[np.void]:
        """Return the monitor's state after each tick."""
        return self._monitor(parameters).follow(*self._signals())

    def assess(self, parameters: MonitorParameters) -> Assessment:
        return self._monitor(parameters).assess(*self._signals())

    def _monitor(self, parameters: MonitorParameters) -> Monitor:
        monitor = Monitor(parameters)
        monitor.expect(self.t_d_ns, self.plan.q_d)
        return monitor

    def _signals(self) -> tuple[NDArray, ...]:
        signals = (np.ascontiguousarray(self.ticks[name]) for name in ("t_ns", "residual", "q", "dq"))
        return (*signals, self.plan.dq_post)


def plan_case(study: Study, approach_deg: float, location_m: float) -> Plan:
    """Plan the impact at this place; the surface is meant to be horizontal."""
    return plan_impact(study.arm, study.task, study.gains, np.radians(approach_deg), location_m)


def simulate_case(study: Study, plan: Plan, case: Case, residual_rate_nm_s: float) -> Impact[Plan]:
    inclination, rates = np.radians(case.inclination_deg), (residual_rate_nm_s,) * 3
    ticks = simulate(study.arm, study.contact, study.task, study.gains, rates, plan, case.location_m, inclination)
    return Impact(case, plan, ticks)
