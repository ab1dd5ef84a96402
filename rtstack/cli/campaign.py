"""`rtstack campaign`: everything is checked before the folder is made and a worker started."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from rtstack.campaign.plan import GRAB_STUDY, Plan, PlanFile, load_plan, plan_file
from rtstack.campaign.store import Store, check_folder, check_place
from rtstack.campaign.worker import Bench, digests
from rtstack.cli import study, validation
from rtstack.cli.campaign_cell import LabCell, open_conditioned_cell, plant_files
from rtstack.cli.cells import load_description, plant_difference
from rtstack.cli.invocation import crew, end, run_counted
from rtstack.impact_validation.plan import is_validation
from rtstack.model.cell_description import CellDescription
from rtstack.studies.aim_aware.tuned import study_kind
from rtstack.trials.errors import TrialError
from rtstack.trials.object import check_object

INTERRUPTED = 1


def campaign(
    name: str, out: Path, quick: bool, workers: int | None, scheduler: str | None, resume: bool,
    logs: str | None = None, cell_file: Path | None = None,
) -> None:  # fmt: skip
    """Run the campaign `name` in the folder `out`, or what is missing of it, and write its report.

    logs: where recordings and logs go, if not to `out`: an address that fsspec knows, such as s3://BUCKET/PREFIX.
    cell_file: of a lab, with objects of its own.
    """
    if scheduler is not None and workers is not None:
        raise TrialError("--workers starts processes here, --scheduler has workers of its own: give one of them")
    if logs is not None and "://" not in logs:
        raise TrialError(f"--logs {logs} is no address such as s3://BUCKET/PREFIX; for a folder give --out alone")
    if name == GRAB_STUDY:
        _refuse(logs, cell_file, name)
        from rtstack.cli.grab_study import grab_study

        grab_study(out, quick, workers, scheduler, resume)
        return
    file = plan_file(name)
    out = out.resolve()
    at_once = workers or len(os.sched_getaffinity(0))
    kind = study_kind(file.path)
    if kind is not None:
        _refuse(logs, cell_file, name)
        prepared = study.prepare(kind, file, out, quick, resume)
        with resumable(_again(name, out, quick)):
            study.run_all(prepared, file, out, at_once, scheduler)
        return
    if is_validation(file.path):
        _refuse(logs, cell_file, name)
        plan, bench, described = validation.prepare(file, out, quick, resume)
        with resumable(_again(name, out, quick)):
            validation.run_all(plan, bench, described, file, at_once, scheduler)
        return
    plan = load_plan(file.path, quick)
    given = cell_file is not None
    description, cell_file = load_description(cell_file.resolve() if cell_file is not None else None)
    for thing in dict.fromkeys(reference.object for reference in plan.references()):
        check_object(thing, description)
        if given and (other := plant_difference(cell_file, thing)):
            print(f"rtstack: warning: {other}", file=sys.stderr)
    sources = [file.path, cell_file, *plant_files()]
    plan = plan.sealed([path.read_bytes() for path in sources])
    check_folder(out, plan, resume)
    open_cell = LabCell(cell_file) if given else open_conditioned_cell
    bench = Bench(out, cell_file, open_cell, plan.criterion, plan.digest, digests(sources), logs)
    bench.archive.check()
    check_place(out, logs)
    again = _again(name, out, quick) + (f" --logs {logs}" if logs else "")
    with resumable(again + (f" --cell-file {cell_file}" if given else "")):
        _run(bench, plan, file, description, at_once, scheduler)


def _refuse(logs: str | None, cell_file: Path | None, name: str) -> None:
    if cell_file is not None:
        raise TrialError(f"--cell-file is for campaigns that compare controllers: {name} has a cell of its own")
    if logs is not None:
        raise TrialError(f"--logs is for campaigns that compare controllers: {name} works in its folder alone")


@contextmanager
def resumable(again: str) -> Iterator[None]:
    """End the program in order at Ctrl-C, with the command that goes on."""
    with interruptible():
        try:
            yield
        except KeyboardInterrupt:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            print(f"rtstack: interrupted; go on with: {again}", file=sys.stderr)
            sys.stderr.flush()
            os._exit(INTERRUPTED)


def _run(
    bench: Bench, plan: Plan, file: PlanFile, description: CellDescription, workers: int, scheduler: str | None
) -> None:
    from rtstack.campaign.crew import slots
    from rtstack.campaign.report import write_report
    from rtstack.campaign.runner import Runner
    from rtstack.cli.campaign_progress import campaign_progress

    with crew(workers, scheduler) as client:
        at_once = slots(client)
        bench.out.mkdir(exist_ok=True)
        with Store(bench.out) as store:
            store.claim(plan, file, bench.archive.place)
            with campaign_progress() as progress:
                runner = Runner(plan, bench, store, client, progress, description)
                tally = run_counted(runner, store, at_once)
            page = write_report(store, plan, file, description, runner.chosen, bench.archive)
    print(
        f"{tally.trials} trials, {tally.robot_s:.0f} s of the robot in {tally.wall_s:.0f} s with {at_once} workers: "
        f"{tally.real_time_factor:.1f} x real time, logs included"
        if tally.trials
        else "no trial was missing"
    )
    end(page, tally.failures)


def _again(name: str, out: Path, quick: bool) -> str:
    return f"rtstack campaign {name} --out {out}{' --quick' * quick} --resume"


@contextmanager
def interruptible() -> Iterator[None]:
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
