"""`rtstack bench`: what this machine makes of the stack."""

from pathlib import Path
from typing import Annotated

import typer

from rtstack.cli.commands.options import FAILED, CellKind, Json, LogOut
from rtstack.samples import QpSolver

commands = typer.Typer(help="Measure the stack on this machine.")


@commands.command("tick")
def bench_tick(
    ticks: Annotated[int, typer.Option(help="Ticks of each kind.", min=100)] = 3000,
    solver: Annotated[QpSolver | None, typer.Option(help="Library to ask where the active set has no answer.")] = None,
    json: Json = False,
) -> None:
    """The dual-arm tick and its parts, beside the same tick in plain numpy, in one run."""
    from dataclasses import replace

    from rtstack.bench.tick import bench_tick
    from rtstack.cells import load_description
    from rtstack.trials.assembly import default_parameters

    parameters = default_parameters()
    if solver is not None:
        parameters = replace(parameters, solver=solver)
    _print(bench_tick(load_description(None)[0], parameters, ticks).as_dict(), json)


@commands.command("loop")
def bench_loop(
    cell: CellKind = "realtime",
    seconds: Annotated[float, typer.Option(help="Length of the run.", min=6.0)] = 20.0,
    log: LogOut = None,
    json: Json = False,
) -> None:
    """The whole loop: both arms grab and hold a box, controlled, judged and logged."""
    from tempfile import TemporaryDirectory

    from rtstack.bench.loop import long_grab, loop_figures
    from rtstack.cells import load_description, open_cell
    from rtstack.cli.interrupt import interruptible
    from rtstack.log.writer import check_log_path
    from rtstack.trials.demonstration import run_demonstration
    from rtstack.trials.record import open_log
    from rtstack.trials.run_context import RunContext
    from rtstack.trials.specification import DemonstrationSpecification
    from rtstack.trials.start_motion import start_motion

    if log is not None:
        check_log_path(log)
    description, source = load_description(None)
    asked = DemonstrationSpecification()
    with TemporaryDirectory() as folder:
        path = log or Path(folder) / "loop.mcap"
        opened = open_cell(cell, asked.object, 0.0, asked.seed, description)
        try:
            way = start_motion(opened, description, asked.object)
            with interruptible() as stop:
                context = RunContext(open_log(path, asked, description, cell, source), stop=stop)
                result = run_demonstration(asked, description, opened, context, way=way, script=long_grab(seconds))
        finally:
            opened.close()
        figures = loop_figures(path, cell, result.success, result.failure_reason)
    _print(figures.as_dict(), json)
    if not figures.success:
        raise typer.Exit(FAILED)


@commands.command("link")
def bench_link(
    cell: Annotated[str, typer.Option(help="lockstep, realtime or fci:LEFT,RIGHT.")] = "lockstep",
    ticks: Annotated[int, typer.Option(help="Milliseconds of the robot.", min=200)] = 3000,
    json: Json = False,
) -> None:
    """The way from a state to its answer to the next state, over the wire, with both arms."""
    from rtstack.bench.link import bench_link
    from rtstack.cells import load_description, open_cell
    from rtstack.cli.hold_to_run import HoldToRun
    from rtstack.cli.interrupt import interruptible

    description, source = load_description(None)
    hold = HoldToRun(cell, description, source)
    opened = open_cell(cell, "rice_box", 0.0, 0, description)
    try:
        with interruptible() as stop, hold.held("hold of both arms", stop):
            _print(bench_link(opened, ticks, description, stop).as_dict(), json)
    finally:
        opened.close()


def _print(values: dict[str, object], json: bool) -> None:
    if json:
        from json import dumps

        typer.echo(dumps(values))
        return
    width = max(len(name) for name in values)
    for name, value in values.items():
        typer.echo(f"{name:<{width}}  {value}")
