"""The work of a worker: all inclinations of a planned impact, each simulated once and judged by every tuning."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtstack.experiments.experiment import Row
from rtstack.monitor.parameters import MonitorParameters
from rtstack.papers.aim_aware.classification import Impact, plan_case, simulate_case
from rtstack.papers.aim_aware.outline import Case
from rtstack.papers.aim_aware.planar.plan import Plan
from rtstack.papers.aim_aware.study import StudyRun


def columns(run: StudyRun) -> dict[str, Any]:
    known: dict[str, Any] = {
        "approach_deg": float, "location_m": float, "inclination_deg": float, "tuned_on": bool,
        "contact": int, "impulse_ns": float, "second_ms": float, "impacts": int, "first_ms": float, "last_ms": float,
    }  # fmt: skip
    return known | verdict_columns(run.monitors())


def verdict_columns(names: Iterable[str]) -> dict[str, Any]:
    """Return the columns of `verdicts`, and of the computing time: name -> type."""
    known: dict[str, Any] = {}
    for name in names:
        known |= {f"verdict_{name}": str, f"reason_{name}": str, f"joint_{name}": int, f"margin_{name}": float}
    return known | {"cpu_s": float}


def verdicts(impact: Impact, monitors: Mapping[str, MonitorParameters]) -> Row:
    """Return each tuning's verdict on an impact, and the detected impacts; first_ms, last_ms: from the planned time."""
    row: Row = {}
    for name, parameters in monitors.items():
        found = impact.assess(parameters)
        row[f"verdict_{name}"], row[f"reason_{name}"] = found.verdict.name.lower(), found.reason.name.lower()
        row[f"joint_{name}"], row[f"margin_{name}"] = found.joint, found.margin
        offsets = [1e-6 * (t_ns - impact.t_d_ns) for t_ns in (found.t_first_ns, found.t_impact_ns)]
        row["impacts"] = found.impacts
        row["first_ms"], row["last_ms"] = offsets if found.impacts else (None, None)
    return row


def run_cases(run: StudyRun, cases: Sequence[Case]) -> list[Row]:
    """Return the rows of cases with one contact and planned impact. impulse_ns: the smaller one of the two corners."""
    run = run.at(cases[0].contact)
    began_s = time.process_time()
    study, monitors = run.study, run.monitors()
    seen = set(study.coarse.cases())
    plan = plan_case(study, cases[0].approach_deg, cases[0].location_m)
    rows: list[Row] = []
    for case in cases:
        impact = simulate_case(study, plan, case, run.tuned.residual_rate_nm_s)
        second_ms = _second_ms(impact, run.tuned.residual_rate_nm_s)
        row = {"id": case.id, **asdict(case), "tuned_on": case in seen, "second_ms": second_ms}
        rows.append(row | {"impulse_ns": float(plan.impulses.min())} | verdicts(impact, monitors))
    cpu_s = (time.process_time() - began_s) / len(rows)
    return [row | {"cpu_s": cpu_s} for row in rows]


def _second_ms(impact: Impact[Plan], rate_nm_s: float) -> float | None:
    """Return the time from the second corner's first contact to the next detected impact (9), ms; None without one."""
    touching = impact.ticks["forces"] > 0.0
    if not touching.any(axis=0).all():
        return None
    second = int(touching.argmax(axis=0).max())
    step_s = 1e-9 * np.diff(impact.ticks["t_ns"])[:, None]
    high = np.abs(np.diff(impact.ticks["residual"], axis=0)) >= rate_nm_s * step_s
    rises: NDArray[np.bool_] = np.any(high[1:] & ~high[:-1], axis=1)
    later = np.flatnonzero(rises[max(second - 1, 0) :])  # from tick second + 1 on
    return float(later[0] + 1) if len(later) else None
