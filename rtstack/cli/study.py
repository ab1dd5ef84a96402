"""`rtstack campaign` for the studies that simulate plants of their own: checked, run on workers, reported."""

import sys
from pathlib import Path

import typer

from rtstack.campaign.plan import PlanFile
from rtstack.campaign.store import Store, check_folder
from rtstack.studies.aim_aware.study import StudyRun, load_run
from rtstack.studies.aim_aware.worker import columns, run_plan

FAILED = 1


def prepare(file: PlanFile, out: Path, quick: bool, resume: bool) -> StudyRun:
    """Check everything before the folder is made. Raises ConfigurationError or TrialError."""
    run = load_run(file.path, quick)
    check_folder(out, run, resume, columns(run))
    return run


def run_all(run: StudyRun, file: PlanFile, out: Path, workers: int, scheduler: str | None) -> None:
    """Run what is missing, and write the report."""
    from rtstack.campaign.crew import distant_crew, local_crew
    from rtstack.cli.campaign_progress import campaign_progress
    from rtstack.studies.aim_aware.report import write_report
    from rtstack.studies.aim_aware.runner import run_study

    with (
        campaign_progress() as progress,
        distant_crew(scheduler) if scheduler else local_crew(workers) as client,
    ):
        out.mkdir(exist_ok=True)
        with Store(out, columns(run)) as store:
            store.claim(run, file)
            # one here before the workers begin: what is compiled, is compiled once
            progress.begin("compiling", 0, 1)
            first = next(run.grid.cases())
            run_plan(run, first.approach_deg, first.location_m, (first.inclination_deg,))
            progress.advance(0.0)
            failures = run_study(run, store, client, progress)
            page = write_report(store, run, file)
            rows = store.rows()
    print(f"{len(rows)} simulations, {sum(row['cpu_s'] for row in rows):.0f} s of a CPU")
    print(f"report: {page}", flush=True)
    for what, reason in failures.items():
        print(f"rtstack: {what} could not be run: {reason}", file=sys.stderr)
    if failures:
        print("rtstack: run the same with --resume to try them again", file=sys.stderr)
        raise typer.Exit(FAILED)
