"""One invocation of a campaign: what is missing is run, on workers or on arms, and the report is written."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from distributed import Client

from rtstack.experiments import attempts
from rtstack.experiments.cell.host import CellHost
from rtstack.experiments.cell.runner import CellRunner
from rtstack.experiments.cell.schedule import schedule_of
from rtstack.experiments.comparison import compare
from rtstack.experiments.experiment import DIRECT, Experiment, Results
from rtstack.experiments.preliminary import Preliminary
from rtstack.experiments.progress import campaign_progress
from rtstack.experiments.report import Report, write_report
from rtstack.experiments.runner import Runner, Tally
from rtstack.experiments.store import DATABASE, Store, check_folder
from rtstack.experiments.workers import slots

BESIDE = "simulated"  # the folder, in that of a campaign on arms, of the same plan's simulated run


@dataclass(frozen=True, slots=True)
class Invocation:
    """What came of it. page: the report's path; at_once: how many cases were run at a time."""

    report: Report
    page: Path
    tally: Tally
    at_once: int


def invoke(
    experiment: Experiment[Any, Any], client: Client, host: CellHost | None = None,
    told: Callable[[str], None] = lambda text: None,
) -> Invocation:  # fmt: skip
    """Run what is missing and write the report. host: of a cell's arms, on which the cases run; told: see Progress.

    A campaign on arms is then run in the simulator too, with the same cases, and its report has both beside each other.
    Raises TrialError where the cases cannot be run.
    """
    at_once = slots(client)
    out = experiment.request.out
    out.mkdir(exist_ok=True)
    with Store(out, experiment.columns) as store:
        store.claim(experiment)
        with campaign_progress(out, told) as progress:
            parts = experiment, store, client, progress, Preliminary(experiment, store)
            runner = Runner(*parts) if host is None else CellRunner(*parts, host=host)
            try:
                runner.run()
            finally:
                tally = runner.tally
                store.note_invocation(tally.rows, tally.robot_s, tally.wall_s, at_once)
        rows = store.rows(experiment.cases(store.rows()))
        report = experiment.report(Results(rows, out))
        page = write_report(report, experiment, store, rows)
        if host is not None:
            done, drift = store.attempts(), schedule_of(experiment.specification).drift
            report = replace(
                _beside_simulation(report, experiment, client),
                figures=(*report.figures, *attempts.figures(done, drift)),
            )
            report = replace(report, tables=(*attempts.tables(done, drift), *report.tables))
            page = write_report(report, experiment, store, rows)
    return Invocation(report, page, tally, at_once)


def _beside_simulation(report: Report, experiment: Experiment[Any, Any], client: Client) -> Report:
    """Return the report of a campaign on arms with its simulated run beside it, which is made or gone on with."""
    out = experiment.request.out / BESIDE
    simulated = type(experiment)(experiment.specification, replace(experiment.request, cell=DIRECT, out=out))
    check_folder(simulated, resume=(out / DATABASE).exists())
    for name in experiment.made:  # the simulated cases follow the same references
        shutil.copytree(experiment.request.out / name, out / name, dirs_exist_ok=True)
    invoke(simulated, client)
    beside = compare(out, experiment.request.out).tables("the simulation", "the arms")
    return replace(report, tables=(*report.tables, *beside))
