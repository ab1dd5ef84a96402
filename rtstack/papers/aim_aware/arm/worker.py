"""The work of a worker: the repetitions of a hit, each judged by every tuning."""

import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from hal.base.configuration import ConfigurationError
from rtstack.experiments.experiment import CellRun, Row
from rtstack.experiments.seeds import seed_of
from rtstack.log.reader import Log
from rtstack.loop.end import End
from rtstack.papers.aim_aware.arm.hits import hit_case, learn, nominal_hits, plan_case, prepare_hit, prior
from rtstack.papers.aim_aware.arm.study import ArmRun, platform_cell_file
from rtstack.papers.aim_aware.classification import Impact
from rtstack.papers.aim_aware.grid import Case
from rtstack.papers.aim_aware.platform.hit import Hit, PreparedHit, hit_parameters, ticks_of
from rtstack.papers.aim_aware.platform.plan import HitPlan
from rtstack.papers.aim_aware.worker import verdict_columns, verdicts
from rtstack.papers.demonstrations import campaign_record, record_of
from rtstack.trials.record import cell_attachments, whole_run_log
from rtstack.trials.review import log_columns


def columns(run: ArmRun) -> dict[str, Any]:
    known: dict[str, Any] = {
        "approach_deg": float, "location_m": float, "inclination_deg": float, "repetition": int, "seed": int,
        "contact": int, "stopped": str, "impacts": int, "first_ms": float, "last_ms": float,
    }  # fmt: skip
    return known | verdict_columns(run.monitors())


def _prepared(run: ArmRun, case: Case) -> PreparedHit:
    plan = plan_case(run.study, case, run.tuned.learned[f"{case.approach_deg:g}"])
    monitoring = next(iter(run.monitors().values()))  # all tunings have the same detection
    return prepare_hit(run.study, case, plan, monitoring, _seed(run, case))


def _seed(run: ArmRun, case: Case) -> int:
    return seed_of(run.study.seed, "judged", case.id)


def judged_case(run: ArmRun, case: Case) -> tuple[Impact[HitPlan], Hit]:
    """Return a case of the report: the impact and the hit. Writes the hit's log where the run has a folder for logs."""
    prepared, log = _prepared(run, case), None
    if run.logs is not None:
        log = whole_run_log(
            run.logs.path / f"{case.id}.mcap", prepared.specification, prepared.description,
            cell_attachments(platform_cell_file(), prepared.description), run.cell,
            campaign=campaign_record(case, run.logs.digest),
        )  # fmt: skip
    done = hit_case(run.study, case, prepared, log, run.cell)
    if log is not None and not log.path.exists():
        raise OSError(done.failure_reason)
    return Impact(case, prepared.plan, done.ticks), done


def on_arms(run: ArmRun, case: Case, path: Path) -> CellRun:
    """Return a hit as a run on a cell's arm, which goes to the start of the plan by itself. path: of its log."""
    setup = f"set the platform to {case.inclination_deg:g} degrees"
    return CellRun(_prepared(run, case), path, record_of(case), setup=setup)


def row_of_log(run: ArmRun, case: Case, log: Log) -> Row:
    reason = log.metadata["result"]["failure_reason"]
    prepared, end = _prepared(run, case), End.in_reason(reason)
    parameters = hit_parameters(prepared.description, prepared.gains, prepared.plan)
    ticks = ticks_of(log_columns(log), prepared.description, parameters, end)
    followed = end is End.COMPLETED or len(ticks) == len(prepared.plan.ante)
    stopped = "" if followed else reason.removeprefix(f"{end}: ")
    return _row(run, Impact(case, prepared.plan, ticks), stopped) | {"cpu_s": None}


def _row(run: ArmRun, impact: Impact[HitPlan], stopped: str) -> Row:
    case = impact.case
    row: Row = {"id": case.id, **asdict(case), "seed": _seed(run, case), "stopped": stopped}
    return row | verdicts(impact, run.monitors())


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
        impact, done = judged_case(run, case)
        rows.append(_row(run, impact, failed or done.stopped))
    cpu_s = (time.process_time() - began_s) / len(rows)
    return [row | {"cpu_s": cpu_s} for row in rows]
