"""`rtstack campaign`: everything is checked before the folder is made and a worker started."""

import gc
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from json import dumps
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hal.extensions import blaming
from rtstack.cli.exit_status import FAILED
from rtstack.cli.interrupt import handled
from rtstack.cli.options import CellFile, Json, Profile
from rtstack.cli.progress import progress_bar
from rtstack.cli.tables import print_table
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:
    from rtstack.cli.stack_operator import StackOperator
    from rtstack.experiments.cell.host import CellHost
    from rtstack.experiments.experiment import Experiment, Request
    from rtstack.experiments.report import Report

commands = typer.Typer()
STACK = "stack"  # --cell: the arms are the running stack's


@commands.command()
def campaign(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="A plan in deploy/campaigns, such as reference-spreading.")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where references, logs, results and report go.")],
    quick: Annotated[bool, typer.Option("--quick", help="A sample of it, which takes some minutes.")] = False,
    workers: Annotated[int | None, typer.Option(help="Processes on this machine; one a CPU.", min=1, max=256)] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Use the workers of this Dask scheduler.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what is missing in DIR.")] = False,
    logs: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Keep references and logs there, not in DIR: s3://BUCKET/PREFIX."),
    ] = None,
    cell: Annotated[
        str | None,
        typer.Option(
            help="direct (the default); lockstep: over the wire, with the same rows; fci:LEFT,RIGHT: arms; stack: the "
            "arms of the stack that runs here (stack:SOCKET where there are several)."
        ),
    ] = None,
    cell_file: CellFile = None,
    profile: Profile = None,
    webhook: Annotated[
        str | None, typer.Option(metavar="URL", help="Tell it there, as JSON, when a person is needed, and at the end.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Measurements of others, for the campaign reality.")
    ] = None,
) -> None:
    """Run many trials and write what they show: figures, tables, and each claim with a verdict."""
    from rtstack.experiments.experiment import Request
    from rtstack.experiments.registry import plan_file
    from rtstack.experiments.store import check_folder
    from rtstack.experiments.webhook import Webhook

    if scheduler is not None and workers is not None:
        raise TrialError("--workers starts processes here, --scheduler has workers of its own: give one of them")
    if logs is not None and "://" not in logs:
        raise TrialError(f"--logs {logs} is no address such as s3://BUCKET/PREFIX; for a folder give --out alone")
    cell_file, data = (each and each.resolve() for each in (cell_file, data))
    out, host = out.resolve(), None
    if cell is not None and cell.partition(":")[0] == STACK:
        host = _stack_operator(cell, name, out, cell_file)
    options = {"cell": cell, "logs": logs, "cell_file": cell_file, "profile": profile, "data": data}
    given = {name: value for name, value in options.items() if value is not None}
    at = {} if host is None else {"cell": f"{STACK}:{host.kind}", "cell_file": host.cell_file}
    request = Request(plan_file(name), out, **given | at)
    experiment = _opened(name, request, quick, given)
    check_folder(experiment, resume)
    more = "".join(f" --{option.replace('_', '-')} {value}" for option, value in given.items())
    again = f"rtstack campaign {name} --out {request.out}{' --quick' * quick} --resume{more}"
    host = _arms(experiment, name, host)
    again += f" --webhook {webhook}" if webhook else ""
    notify = Webhook(webhook, name) if webhook else lambda event, text: None
    with _resumable(again):
        try:
            _run(experiment, workers or len(os.sched_getaffinity(0)), scheduler, host, notify)
        except TrialError as error:
            notify("stopped", str(error))
            raise


@commands.command("campaign compare")
def campaign_compare(
    first: Annotated[Path, typer.Argument(metavar="DIR")],
    second: Annotated[Path, typer.Argument(metavar="DIR")],
    json: Json = False,
) -> None:
    """Say what differs between two campaigns of one plan: each column of their common rows, each claim.

    Exit status 1 where a row is not common or a column differs.
    """
    from rtstack.experiments.comparison import compare

    found = compare(first, second)
    if json:
        typer.echo(dumps(asdict(found)))
    else:
        for table in found.tables(str(first), str(second)):
            if table.lines:
                print_table(table.headings, table.lines, "")
        typer.echo(found.summary)
    if not found.same:
        raise typer.Exit(FAILED)


@commands.command("campaign pack")
def campaign_pack(folder: Annotated[Path, typer.Argument(metavar="DIR")]) -> None:
    """Make a campaign's folder a data set to publish: columns, units, checksums."""
    from rtstack.experiments.package import pack

    with progress_bar("checksums", True) as progress:
        sums = pack(folder, progress)
    typer.echo(f"{sums}: check with sha256sum --check; columns and units: {folder / 'README.md'}")


def _opened(name: str, request: "Request", quick: bool, given: Iterable[str]) -> "Experiment[Any, Any]":
    """Return the campaign. given: the options of the command line that not every kind takes."""
    from rtstack.experiments.registry import kind_named, kind_of

    kind = kind_named(kind_of(request.file.path))
    for option in given:
        if option not in kind.options:
            taken = ", ".join(f"--{each.replace('_', '-')}" for each in sorted(kind.options)) or "none of these options"
            raise TrialError(f"--{option.replace('_', '-')}: {name} takes none; it takes {taken}")
    with blaming(f"the plan {name} cannot be run", kind.read):
        return kind(kind.read(request.file.path, quick), request)


def _stack_operator(cell: str, name: str, out: Path, cell_file: Path | None) -> "StackOperator":
    """Return the operator of the stack that runs. Raises TrialError, ConfigurationError."""
    from rtstack.cli.stack_operator import StackOperator
    from rtstack.live.client import only_stack

    if cell_file is not None:
        raise TrialError(f"--cell-file {cell_file}: the stack has its own")
    socket = cell.partition(":")[2]
    return StackOperator(Path(socket) if socket else only_stack(f"--cell {STACK}:SOCKET"), name, out)


def _arms(experiment: "Experiment[Any, Any]", name: str, stack: "StackOperator | None") -> "CellHost | None":
    """Return the host at whose arms the cases run, None where they run in the simulator. Raises TrialError."""
    from rtstack.experiments.experiment import SIMULATED

    request = experiment.request
    if request.cell in SIMULATED:
        return None
    if not experiment.runs_on_cell():
        raise TrialError(f"--cell {request.cell}: {name} runs in the simulator: direct, or lockstep")
    if request.logs is not None:
        raise TrialError("--logs: on arms the logs go to --out; copy them once they are there")
    if stack is not None:
        if not experiment.on_stack:
            raise TrialError(f"{name}: the stack knows no such run; give the arms: --cell fci:ADDRESS")
        return stack
    from rtstack.cli.terminal import Terminal

    host = Terminal.of(request.cell, None, experiment.cell_file, f"the campaign {name}")
    host.check()
    return host


def _run(
    experiment: "Experiment[Any, Any]", workers: int, scheduler: str | None, host: "CellHost | None",
    notify: Callable[[str, str], None],
) -> None:  # fmt: skip
    from rtstack.experiments.invocation import invoke
    from rtstack.experiments.workers import distant_workers, local_workers

    with distant_workers(scheduler) if scheduler else local_workers(workers) as client:
        done = invoke(experiment, client, host, lambda text: notify("waiting", text))
    gc.freeze()  # what is left is for the system: the interpreter's end would look at each object, 0.6 s of them
    tally, unit = done.tally, experiment.unit
    pace = f"{tally.rows} {unit} in {tally.wall_s:.0f} s with {done.at_once} workers"
    if tally.robot_s:  # a kind says it by robot_s, or by the column ticks
        pace += f": {tally.robot_s:.0f} s of the robot, {tally.real_time_factor:.1f} x real time"
        pace += ", logs included" * experiment.logged
    if tally.rows or not tally.failures:
        print(pace if tally.rows else f"no {unit.removesuffix('s')} was missing")
    if done.report.summary:
        print(done.report.summary)
    notify("ended", f"{len(tally.failures)} could not be run. {done.report.summary} Report: {done.page}")
    end(done.page, tally.failures, done.report)


def end(page: Path, failures: Mapping[str, str], report: "Report") -> None:
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
    """End the program in order at Ctrl-C or SIGTERM, with the command that goes on; a second one ends it at once."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        raise KeyboardInterrupt

    try:
        with handled(interrupt):
            yield
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        print(f"rtstack: interrupted; go on with: {again}", file=sys.stderr)
        sys.stderr.flush()
        os._exit(FAILED)
