"""What a worker does: the repetitions of a hit, each seen by every tuning."""

import time
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from hal.pad import Pad
from rtstack.experiments.experiment import Row
from rtstack.experiments.seeds import seed_of
from rtstack.model.cell_description import ArmMounting
from rtstack.monitor.parameters import MonitorParameters
from rtstack.papers.aim_aware.arm.study import ArmRun, ArmStudy
from rtstack.papers.aim_aware.classification import Impact
from rtstack.papers.aim_aware.grid import Case
from rtstack.papers.aim_aware.planar.parameters import Task
from rtstack.papers.aim_aware.platform.cell import open_platform_cell
from rtstack.papers.aim_aware.platform.hit import Hit, hit
from rtstack.papers.aim_aware.platform.plan import HitPlan, plan_hit
from rtstack.papers.aim_aware.worker import verdict_columns, verdicts

Twist = tuple[float, float, float]
JUDGED = "judged"


def columns(run: ArmRun) -> dict[str, Any]:
    """Return the columns of the results: name -> type."""
    known: dict[str, Any] = {
        "approach_deg": float, "location_m": float, "inclination_deg": float, "repetition": int, "seed": int,
        "stopped": str, "impacts": int, "first_ms": float, "last_ms": float,
    }  # fmt: skip
    return known | verdict_columns(run.monitors())


@lru_cache(maxsize=16)
def _planned(
    mounting: ArmMounting, pad: Pad, task: Task, approach_deg: float, location_m: float, twist: Twist
) -> HitPlan:
    return plan_hit(mounting, pad, task, np.radians(approach_deg), location_m, np.array(twist))


def plan_case(study: ArmStudy, case: Case, twist: Twist) -> HitPlan:
    """Plan the impact of a case; twist: of the pad after it, as learned."""
    return _planned(study.mounting, study.pad, study.task, case.approach_deg, case.location_m, twist)


def hit_case(
    study: ArmStudy, case: Case, plan: HitPlan, monitoring: MonitorParameters, seed: int, until: int | None = None
) -> Hit:
    """Hit the platform, in a cell of its own."""
    a, b, c, d, e, f, g = map(float, plan.q_start)
    cell = open_platform_cell(study.setup, (a, b, c, d, e, f, g), case.inclination_deg, seed)
    try:
        return hit(cell.left, study.hitter, plan, monitoring, until)
    finally:
        cell.close()


def judged_case(run: ArmRun, case: Case) -> tuple[Impact[HitPlan], Hit, int]:
    """Return a case of the report: the impact, the hit and its seed."""
    plan = plan_case(run.study, case, run.tuned.learned[f"{case.approach_deg:g}"])
    seed = seed_of(run.study.seed, JUDGED, case.id)
    monitoring = next(iter(run.monitors().values()))  # all see the same impacts
    done = hit_case(run.study, case, plan, monitoring, seed)
    return Impact(case, plan, done.ticks), done, seed


def run_hits(run: ArmRun, cases: Sequence[Case]) -> list[Row]:
    """Return a row for each case. stopped: why the robot or the judge ended the hit, else empty."""
    began_s = time.process_time()
    rows: list[Row] = []
    for case in cases:
        impact, done, seed = judged_case(run, case)
        row: Row = {
            "id": case.id, "approach_deg": case.approach_deg, "location_m": case.location_m,
            "inclination_deg": case.inclination_deg, "repetition": case.repetition, "seed": seed,
            "stopped": done.stopped,
        }  # fmt: skip
        rows.append(row | verdicts(impact, run.monitors()))
    cpu_s = (time.process_time() - began_s) / len(rows)
    return [row | {"cpu_s": cpu_s} for row in rows]
