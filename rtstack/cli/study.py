"""`rtstack campaign` for the studies of the collision-monitoring paper: checked, run on workers, reported."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtstack.campaign.plan import PlanFile
from rtstack.campaign.store import Row, Store, check_folder
from rtstack.cli.invocation import crew, end
from rtstack.studies.aim_aware import study as planar
from rtstack.studies.aim_aware import worker as planar_worker
from rtstack.studies.aim_aware.arm import study as arm
from rtstack.studies.aim_aware.arm import worker as arm_worker
from rtstack.studies.aim_aware.grid import Case


@dataclass(frozen=True, slots=True)
class Prepared:
    """A study that may be run: what a worker does with some of its cases, the columns of the rows, and its report."""

    run: Any  # StudyRun or ArmRun, which `work` and `report` take
    work: Callable[[Any, Sequence[Case]], list[Row]]
    columns: dict[str, Any]
    report: Callable[[Store, Any, PlanFile], Path]


def prepare(kind: str, file: PlanFile, out: Path, quick: bool, resume: bool) -> Prepared:
    """Check everything before the folder is made. Raises ConfigurationError or TrialError."""
    prepared = _arm(file, quick) if kind == arm.STUDY else _planar(file, quick)
    check_folder(out, prepared.run, resume, prepared.columns)
    return prepared


def _planar(file: PlanFile, quick: bool) -> Prepared:
    from rtstack.studies.aim_aware.report import write_report

    run = planar.load_run(file.path, quick)
    return Prepared(run, planar_worker.run_cases, planar_worker.columns(run), write_report)


def _arm(file: PlanFile, quick: bool) -> Prepared:
    from rtstack.cli.platform_cell import open_platform_cell, platform_files
    from rtstack.studies.aim_aware.arm.report import write_report

    run = arm.load_arm_run(file.path, quick, open_platform_cell, platform_files())
    return Prepared(run, arm_worker.run_hits, arm_worker.columns(run), write_report)


def run_all(prepared: Prepared, file: PlanFile, out: Path, workers: int, scheduler: str | None) -> None:
    """Run what is missing, and write the report."""
    from rtstack.cli.campaign_progress import campaign_progress
    from rtstack.studies.aim_aware.runner import run_study

    run = prepared.run
    with campaign_progress() as progress, crew(workers, scheduler) as client:
        out.mkdir(exist_ok=True)
        with Store(out, prepared.columns) as store:
            store.claim(run, file)
            # one here before the workers begin: what is compiled, is compiled once
            progress.begin("compiling", 0, 1)
            prepared.work(run, [next(run.grid.cases())])
            progress.advance(0.0)
            failures = run_study(run, prepared.work, store, client, progress)
            page = prepared.report(store, run, file)
            rows = store.rows()
    print(f"{len(rows)} simulations, {sum(row['cpu_s'] for row in rows):.0f} s of a CPU")
    end(page, failures)
