"""The report's numbers as a file, so that a program can compare them with its own."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rtstack.campaign.claims import Claim
from rtstack.campaign.evaluation import NAMES, TABLE2, Evaluation
from rtstack.campaign.plan import Plan
from rtstack.campaign.statistics import Interval

REPORT = "report.json"
FORCES = ("average_force_norm", "average_force_norm_linear_n")
# the columns of results.csv whose means are behind the claims
COLUMNS = (
    *FORCES, "peak_torque_ratio", "detection_delay_ms", "delay_peak", "delay_peak_velocity_share", "peak_in_window",
    "largest_step", "largest_step_ms", "step_to_interim", "step_to_post", "settled_ms", "swing_m_s",
)  # fmt: skip


def write_numbers(out: Path, plan: Plan, parts: list[tuple[Evaluation, list[Claim]]]) -> Path:
    """Write report.json: of each set of conditions the claims with their verdicts, and the figures behind them.

    A figure is a mean with its 95 % interval and n, SI units or as its column says; null where there is none.
    """
    numbers = {"plan": plan.name, "digest": plan.digest, "conditions": [_part(*part) for part in parts]}
    path = out / REPORT
    path.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    return path


def _part(evaluation: Evaluation, claims: list[Claim]) -> dict[str, Any]:
    table2 = evaluation.table2() if evaluation.of(TABLE2) else []
    return {
        "name": evaluation.conditions,
        "claims": [
            {"where": c.where, "claim": c.says, "verdict": str(c.verdict), "figures": c.ours} for c in claims
        ],
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
