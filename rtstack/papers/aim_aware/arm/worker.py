"""The work of a worker: the repetitions of a hit, each judged by every tuning."""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from hal.base.configuration import ConfigurationError
from rtstack.experiments.experiment import Row
from rtstack.experiments.seeds import seed_of
from rtstack.papers.aim_aware.arm.hits import hit_case, learn, nominal_hits, plan_case, prepare_hit, prior
from rtstack.papers.aim_aware.arm.study import ArmRun
from rtstack.papers.aim_aware.classification import Impact
from rtstack.papers.aim_aware.grid import Case
from rtstack.papers.aim_aware.platform.hit import Hit
from rtstack.papers.aim_aware.platform.plan import HitPlan
from rtstack.papers.aim_aware.platform.setup import platform_cell_file
from rtstack.papers.aim_aware.worker import verdict_columns, verdicts
from rtstack.papers.demonstrations import campaign_record
from rtstack.trials.record import cell_attachments, whole_run_log

JUDGED = "judged"


def columns(run: ArmRun) -> dict[str, Any]:
    """Return the columns of the results: name -> type."""
    known: dict[str, Any] = {
        "approach_deg": float, "location_m": float, "inclination_deg": float, "repetition": int, "seed": int,
        "contact": int, "stopped": str, "impacts": int, "first_ms": float, "last_ms": float,
    }  # fmt: skip
    return known | verdict_columns(run.monitors())


def judged_case(run: ArmRun, case: Case) -> tuple[Impact[HitPlan], Hit, int]:
    """Return a case of the report: the impact, the hit and its seed. Writes the hit's log where the run has a folder
    for logs."""
    plan = plan_case(run.study, case, run.tuned.learned[f"{case.approach_deg:g}"])
    seed = seed_of(run.study.seed, JUDGED, case.id)
    monitoring = next(iter(run.monitors().values()))  # all tunings have the same detection
    prepared = prepare_hit(run.study, case, plan, monitoring, seed)
    log = None
    if run.logs is not None:
        log = whole_run_log(
            run.logs.path / f"{case.id}.mcap", prepared.specification, prepared.description,
            cell_attachments(platform_cell_file(), prepared.description), run.cell,
            campaign=campaign_record(case, run.logs.digest),
        )  # fmt: skip
    done = hit_case(run.study, case, prepared, log, run.cell)
    if log is not None and not log.path.exists():
        raise OSError(done.failure_reason)
    return Impact(case, plan, done.ticks), done, seed


def learned_at(run: ArmRun, case: Case) -> tuple[ArmRun, str]:
    """Return the study with the contact of a case and the velocity learned with it; the reason if that failed."""
    at, failed = run.at(case.contact), ""
    if not case.contact:
        return at, failed
    try:
        learned = learn(at.study, nominal_hits(at.study, [case.approach_deg]), run.tuned.residual_rate_nm_s)
    except ConfigurationError as error:
        learned, failed = {f"{case.approach_deg:g}": prior(at.study, case)}, str(error)
    return replace(at, tuned=replace(at.tuned, learned=learned)), failed


def run_cases(run: ArmRun, cases: Sequence[Case]) -> list[Row]:
    """Return a row for each case. stopped: reason if the robot or the safety judge ended the hit."""
    began_s = time.process_time()
    rows: list[Row] = []
    run, failed = learned_at(run, cases[0])
    for case in cases:
        impact, done, seed = judged_case(run, case)
        row: Row = {
            "id": case.id, "approach_deg": case.approach_deg, "location_m": case.location_m,
            "inclination_deg": case.inclination_deg, "repetition": case.repetition, "seed": seed,
            "contact": case.contact, "stopped": failed or done.stopped,
        }  # fmt: skip
        rows.append(row | verdicts(impact, run.monitors()))
    cpu_s = (time.process_time() - began_s) / len(rows)
    return [row | {"cpu_s": cpu_s} for row in rows]
