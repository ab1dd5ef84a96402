"""`rtstack campaign`: everything is checked before the folder is made and a worker started."""

import gc
import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import typer

from rtstack.experiments.experiment import Experiment, Request, Results
from rtstack.experiments.registry import kind_named, kind_of, plan_file
from rtstack.experiments.report import Report
from rtstack.experiments.store import Store, check_folder
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:  # Dask is loaded once there is work
    from rtstack.experiments.runner import Tally

INTERRUPTED = FAILED = 1


def campaign(
    name: str, out: Path, quick: bool, workers: int | None, scheduler: str | None, resume: bool,
    logs: str | None = None, cell_file: Path | None = None, profile: str | None = None,
    data: Path | None = None,
) -> None:  # fmt: skip
    """Run the campaign `name` in the folder `out`, or what is missing of it, and write its report.

    logs: where recordings and logs go, if not to `out`: an address that fsspec knows, such as s3://BUCKET/PREFIX.
    cell_file: of a lab, with objects of its own. profile: of the simulated robot, under all conditions of the plan.
    data: measurements of others, a folder.
    """
    if scheduler is not None and workers is not None:
        raise TrialError("--workers starts processes here, --scheduler has workers of its own: give one of them")
    if logs is not None and "://" not in logs:
        raise TrialError(f"--logs {logs} is no address such as s3://BUCKET/PREFIX; for a folder give --out alone")
    request = Request(
        plan_file(name), out.resolve(), logs, cell_file.resolve() if cell_file is not None else None, profile,
        data.resolve() if data is not None else None,
    )  # fmt: skip
    experiment = _opened(name, request, quick)
    check_folder(experiment, resume)
    again = f"rtstack campaign {name} --out {request.out}{' --quick' * quick} --resume"
    again += (f" --logs {logs}" if logs else "") + (f" --cell-file {request.cell_file}" if request.cell_file else "")
    again += (f" --profile {profile}" if profile else "") + (f" --data {data}" if data else "")
    with _resumable(again):
        _run(experiment, workers or len(os.sched_getaffinity(0)), scheduler)


def _opened(name: str, request: Request, quick: bool) -> Experiment[Any, Any]:
    kind = kind_named(kind_of(request.file.path))
    for option, given in (("logs", request.logs), ("cell_file", request.cell_file), ("profile", request.profile),
                          ("data", request.data)):  # fmt: skip
        if given is not None and option not in kind.options:
            taken = ", ".join(f"--{each.replace('_', '-')}" for each in sorted(kind.options)) or "none of these options"
            raise TrialError(f"--{option.replace('_', '-')}: {name} takes none; it takes {taken}")
    return kind(kind.read(request.file.path, quick), request)


def _run(experiment: Experiment[Any, Any], workers: int, scheduler: str | None) -> None:
    from rtstack.experiments.preliminary import Preliminary
    from rtstack.experiments.progress import campaign_progress
    from rtstack.experiments.report import write_report
    from rtstack.experiments.runner import Runner
    from rtstack.experiments.workers import distant_workers, local_workers, slots

    with distant_workers(scheduler) if scheduler else local_workers(workers) as client:
        at_once = slots(client)
        experiment.request.out.mkdir(exist_ok=True)
        with Store(experiment.request.out, experiment.columns) as store:
            store.claim(experiment)
            with campaign_progress(store.out) as progress:
                runner = Runner(experiment, store, client, progress, Preliminary(experiment, store))
                try:
                    runner.run()
                finally:
                    tally = runner.tally
                    store.note_invocation(tally.rows, tally.robot_s, tally.wall_s, at_once)
            rows = store.rows(experiment.cases(store.rows()))
            report = experiment.report(Results(rows, store.out))
            page = write_report(report, experiment, store, rows)
    gc.freeze()  # what is left is for the system: the interpreter's end would look at each object, 0.6 s of them
    print(_pace(experiment, tally, at_once))
    if report.summary:
        print(report.summary)
    end(page, tally.failures, report)


def _pace(experiment: Experiment[Any, Any], tally: "Tally", at_once: int) -> str:
    unit = experiment.unit
    if not tally.rows:
        return f"no {unit.removesuffix('s')} was missing"
    return (
        f"{tally.rows} {unit}, {tally.robot_s:.0f} s of the robot in {tally.wall_s:.0f} s with {at_once} workers: "
        f"{tally.real_time_factor:.1f} x real time{', logs included' * experiment.logged}"
    )


def end(page: Path, failures: Mapping[str, str], report: Report) -> None:
    """Say where the report is and what could not be run, and why. Exits with 1 for that, or as the report says."""
    print(f"report: {page}", flush=True)
    for line in report.warnings:
        print(f"rtstack: {line}", file=sys.stderr)
    for what, reason in failures.items():
        print(f"rtstack: {what} could not be run: {reason}", file=sys.stderr)
    if failures:
        print("rtstack: run the same with --resume to try them again", file=sys.stderr)
    if failures or not report.reached:
        raise typer.Exit(FAILED)


@contextmanager
def _resumable(again: str) -> Iterator[None]:
    """End the program in order at Ctrl-C, with the command that goes on."""
    with _interruptible():
        try:
            yield
        except KeyboardInterrupt:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            print(f"rtstack: interrupted; go on with: {again}", file=sys.stderr)
            sys.stderr.flush()
            os._exit(INTERRUPTED)


@contextmanager
def _interruptible() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM break the work off in order; a second one ends the program at once."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        raise KeyboardInterrupt

    previous = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
