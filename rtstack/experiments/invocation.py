"""One invocation of a campaign: what is missing is run, on workers or on arms, and the report is written."""

import shutil
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from distributed import Client

from hal.extensions import PLUG_INS_RAISE, raised
from rtstack.experiments import attempts
from rtstack.experiments.cell.host import CellHost
from rtstack.experiments.cell.runner import CellRunner
from rtstack.experiments.cell.schedule import schedule_of
from rtstack.experiments.comparison import compare
from rtstack.experiments.experiment import DIRECT, Experiment, Results
from rtstack.experiments.progress import campaign_progress
from rtstack.experiments.report import Report, write_preliminary, write_report
from rtstack.experiments.runner import Runner, Tally
from rtstack.experiments.store import Store
from rtstack.experiments.workers import slots

BESIDE = "simulated"  # the folder, in that of a campaign on arms, of the same plan's simulated run

EVERY_S = 30.0  # between two drawings of figures
SHARE = 0.05  # of the runner's time at most


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
            report = _beside_simulation(report, experiment, client)
            figures = (*report.figures, *attempts.figures(done, drift))
            report = replace(report, figures=figures, tables=(*attempts.tables(done, drift), *report.tables))
            page = write_report(report, experiment, store, rows)
    return Invocation(report, page, tally, at_once)


def _beside_simulation(report: Report, experiment: Experiment[Any, Any], client: Client) -> Report:
    out = experiment.request.out / BESIDE
    simulated = type(experiment)(experiment.specification, replace(experiment.request, cell=DIRECT, out=out))
    for name in experiment.made:  # the simulated cases follow the same references
        shutil.copytree(experiment.request.out / name, out / name, dirs_exist_ok=True)
    invoke(simulated, client)
    beside = compare(out, experiment.request.out).tables("the simulation", "the arms")
    return replace(report, tables=(*report.tables, *beside))


class Preliminary:
    """Draws figures and claims of a campaign that goes on: called after each result, it draws now and then."""

    def __init__(self, experiment: Experiment[Any, Any], store: Store) -> None:
        self._experiment = experiment
        self._store = store
        self._due_s = time.monotonic() + EVERY_S

    def __call__(self) -> None:
        began_s = time.monotonic()
        if began_s < self._due_s:
            return
        rows = self._store.rows(self._experiment.cases(self._store.rows()))
        try:
            report = self._experiment.report(Results(rows, self._store.out, preliminary=True))
            write_preliminary(report, self._experiment, self._store)
        except PLUG_INS_RAISE as error:  # of a kind's report: the results matter more than a picture of them
            print(f"rtstack: no figures meanwhile: {raised(error)}", file=sys.stderr, flush=True)
            self._due_s = float("inf")
            return
        ended_s = time.monotonic()
        self._due_s = ended_s + max(EVERY_S, (ended_s - began_s) / SHARE)
