"""`rtstack bench`: what this machine makes of the stack."""

from contextlib import closing
from dataclasses import replace
from json import dumps
from typing import Annotated

import typer

from rtstack.cli.interrupt import interruptible
from rtstack.cli.options import CellFile, Json
from rtstack.samples import QpSolver

commands = typer.Typer()
bench = typer.Typer(help="Measure the stack on this machine.")
commands.add_typer(bench, name="bench")


@bench.command("tick")
def bench_tick(
    ticks: Annotated[int, typer.Option(help="Ticks of each kind.", min=100)] = 3000,
    solver: Annotated[QpSolver | None, typer.Option(help="Library to ask where the active set has no answer.")] = None,
    json: Json = False,
) -> None:
    """The dual-arm tick and its parts, with no limit active and with one."""
    from rtstack.bench.tick import bench_tick
    from rtstack.cells import load_description
    from rtstack.trials.assembly import default_parameters

    parameters = default_parameters()
    parameters = parameters if solver is None else replace(parameters, solver=solver)
    _print(bench_tick(load_description(None)[0], parameters, ticks), json)


@bench.command("link")
def bench_link(
    cell: Annotated[str, typer.Option(help="lockstep, realtime or fci:LEFT,RIGHT.")] = "lockstep",
    cell_file: CellFile = None,
    ticks: Annotated[int, typer.Option(help="Milliseconds of the robot.", min=200)] = 3000,
    json: Json = False,
) -> None:
    """The way from a state to its answer to the next state, over the wire, with all arms at once."""
    from rtstack.bench.link import bench_link
    from rtstack.cells import load_description, open_cell
    from rtstack.cli.hold_to_run import HoldToRun

    description, source = load_description(cell_file, cell)
    hold = HoldToRun(cell, description, source)
    opened = open_cell(cell, next(iter(description.objects)), 0.0, 0, description, cell_file=source)
    with closing(opened), interruptible() as stop, hold.held("hold of the arms", stop):
        _print(bench_link(opened, ticks, description, stop).as_dict(), json)


def _print(values: dict[str, object], json: bool) -> None:
    if json:
        typer.echo(dumps(values))
        return
    width = max(map(len, values))
    for name, value in values.items():
        typer.echo(f"{name:<{width}}  {value}")
