"""The whole loop on a cell: both arms grab the box, hold it for most of the time, and put it down; all of it logged.

Every figure is computed from the log that the run has written, as any other reader could.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hal.cell import Cell
from rtstack.log.reader import read_log
from rtstack.references.demonstration import Grab, duration_s
from rtstack.samples import SIDES
from rtstack.trials.demonstration import PreparedDemonstration, run_demonstration
from rtstack.trials.result import DemonstrationResult
from rtstack.trials.run_context import RunContext
from rtstack.trials.start_motion import StartMotion

CONTACT_N = 5.0
_SETTLE = 100  # ticks: control_command_success_rate covers the last 100


@dataclass(frozen=True, slots=True)
class LongGrab(PreparedDemonstration):
    """A demonstration of this length, s, at least 6: what is added is spent carrying."""

    seconds: float

    def run(self, cell: Cell, context: RunContext, way: StartMotion | None) -> DemonstrationResult:
        """See PreparedRun."""
        plain = Grab()
        script = Grab(carry_s=plain.carry_s + self.seconds - duration_s(plain))
        return run_demonstration(self.specification, self.description, cell, context, way=way, script=script)


def loop_figures(log: Path, cell: str, result: DemonstrationResult) -> dict[str, object]:
    """Compute the figures of a finished run from its log; pairs are (left, right). Raises LogError.

    real_time_factor: robot's seconds over the host's. missed_deadlines: states without an answer. contact_share: ticks
    in which a pad is pushed with over CONTACT_N.
    """
    topics = read_log(log)
    timing = topics.topic("/timing")
    arms = [topics.topic(f"/{side}/arm") for side in SIDES]
    period_us, compute_us = timing["period_us"][1:], timing["compute_us"]
    host_s = float(period_us.sum()) * 1e-6
    robot_s = float(timing["t_ns"][-1] - timing["t_ns"][0]) * 1e-9
    rates = [arm["control_command_success_rate"][_SETTLE:] for arm in arms]
    pushed = [np.abs(arm["O_F_ext_hat_K"][:, :3]).max(axis=1) > CONTACT_N for arm in arms]
    return {
        "cell": cell,
        "seconds": round(robot_s, 3),
        "success": result.success,
        "failure_reason": result.failure_reason,
        "ticks": len(timing),
        "real_time_factor": round(robot_s / host_s, 5),
        "period_us_p50": _percentile(period_us, 50),
        "period_us_p99": _percentile(period_us, 99),
        "period_us_max": _percentile(period_us, 100),
        "compute_us_p50": _percentile(compute_us, 50),
        "compute_us_p99": _percentile(compute_us, 99),
        "compute_us_max": _percentile(compute_us, 100),
        "missed_deadlines": int(timing["missed_deadlines"][-1]),
        "success_rate_mean": (round(float(rates[0].mean()), 4), round(float(rates[1].mean()), 4)),
        "success_rate_min": (round(float(rates[0].min()), 4), round(float(rates[1].min()), 4)),
        "contact_share": round(float(np.mean(pushed[0] | pushed[1])), 3),
    }


def _percentile(values: NDArray[np.floating], share: float) -> float:
    return round(float(np.percentile(values, share)), 1)
