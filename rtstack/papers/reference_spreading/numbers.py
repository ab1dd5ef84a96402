"""The report's numbers for report.json, so that a program can compare them with its own."""

from dataclasses import asdict
from typing import Any

from rtstack.experiments.statistics import Interval
from rtstack.papers.reference_spreading.evaluation import TABLE2, Evaluation
from rtstack.papers.reference_spreading.names import NAMES

FORCES = ("average_force_norm", "average_force_norm_linear_n")
# the columns of results.csv whose means are behind the claims
COLUMNS = (
    *FORCES, "peak_torque_ratio", "detection_delay_ms", "delay_peak", "delay_peak_velocity_share", "peak_in_window",
    "largest_step", "largest_step_ms", "step_to_interim", "step_to_post", "settled_ms", "swing_m_s",
)  # fmt: skip


def numbers(evaluation: Evaluation) -> dict[str, Any]:
    """Return the figures behind the claims under one set of conditions.

    A figure is a mean with its 95 % interval and n, SI units or as its column says; null where there is none.
    """
    table2 = evaluation.table2() if evaluation.of(TABLE2) else []
    return {
        "table2": [
            {"controller": str(line.controller), "success": _figure(line.success), "lift_mm": _figure(line.lift_mm)}
            for line in table2
        ],
        "figure11": [
            {"controller": str(controller), "displacement_mm": d}
            | {name: _figure(evaluation.mean_force(controller, d, name)) for name in FORCES}
            for d in evaluation.displacements()
            for controller in NAMES
        ],
        "means": [
            {"controller": str(controller), "column": name, "mean": _figure(evaluation.mean(controller, name))}
            for controller in NAMES
            for name in COLUMNS
        ],
    }  # fmt: skip


def _figure(interval: Interval | None) -> dict[str, float | None] | None:
    return None if interval is None else asdict(interval)
