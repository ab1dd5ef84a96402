"""`rtstack bench`: what this machine makes of the stack."""

import json as json_module
from pathlib import Path
from tempfile import TemporaryDirectory

import typer

from rtstack.bench.tick import bench_tick
from rtstack.cells import load_description
from rtstack.samples import QpSolver
from rtstack.trials.assembly import default_parameters

FAILED = 1


def tick(ticks: int, solver: QpSolver | None, json: bool) -> None:
    """Measure the tick and print the figures."""
    from dataclasses import replace

    parameters = default_parameters()
    if solver is not None:
        parameters = replace(parameters, solver=solver)
    description, _ = load_description(None)
    values = bench_tick(description, parameters, ticks).as_dict()
    _print(values, json)


def link(cell_kind: str, ticks: int, json: bool) -> None:
    """Measure the link of a cell and print the figures."""
    from rtstack.bench.link import bench_link
    from rtstack.cells import open_cell
    from rtstack.cli.hold_to_run import HoldToRun
    from rtstack.cli.interrupt import interruptible

    description, source = load_description(None)
    hold = HoldToRun(cell_kind, description, source)
    cell = open_cell(cell_kind, "rice_box", 0.0, 0, description)
    try:
        with interruptible() as stop, hold.held("hold of both arms", stop):
            _print(bench_link(cell, ticks, description, stop).as_dict(), json)
    finally:
        cell.close()


def loop(cell_kind: str, seconds: float, log_path: Path | None, json: bool) -> None:
    """Run the whole loop on a cell for some time and print the figures of its log."""
    from rtstack.bench.loop import long_grab, loop_figures
    from rtstack.cells import open_cell
    from rtstack.cli.interrupt import interruptible
    from rtstack.log.writer import check_log_path
    from rtstack.trials.demonstration import run_demonstration
    from rtstack.trials.record import open_log
    from rtstack.trials.run_context import RunContext
    from rtstack.trials.specification import DemonstrationSpecification
    from rtstack.trials.start_motion import start_motion

    if log_path is not None:
        check_log_path(log_path)
    description, source = load_description(None)
    specification = DemonstrationSpecification()
    with TemporaryDirectory() as folder:
        path = log_path or Path(folder) / "loop.mcap"
        cell = open_cell(cell_kind, specification.object, 0.0, specification.seed, description)
        try:
            way = start_motion(cell, description, specification.object)
            with interruptible() as stop:
                log = open_log(path, specification, description, cell_kind, source)
                result = run_demonstration(
                    specification, description, cell, RunContext(log, stop=stop), way=way, script=long_grab(seconds)
                )
        finally:
            cell.close()
        figures = loop_figures(path, cell_kind, result.success, result.failure_reason)
    _print(figures.as_dict(), json)
    if not figures.success:
        raise typer.Exit(FAILED)


def _print(values: dict[str, object], json: bool) -> None:
    if json:
        typer.echo(json_module.dumps(values))
        return
    width = max(len(name) for name in values)
    for name, value in values.items():
        typer.echo(f"{name:<{width}}  {value}")
