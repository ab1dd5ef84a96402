"""`rtstack bench`."""

from typing import Annotated

import typer

from rtstack.cli.commands.options import CellKind, Json, LogOut
from rtstack.samples import QpSolver

commands = typer.Typer(help="Measure the stack on this machine.")


@commands.command("tick")
def bench_tick(
    ticks: Annotated[int, typer.Option(help="Ticks of each kind.", min=100)] = 3000,
    solver: Annotated[QpSolver | None, typer.Option(help="QP solver; the default is the stack's.")] = None,
    json: Json = False,
) -> None:
    """The dual-arm tick and its parts, beside the same tick in plain numpy, in one run."""
    from rtstack.cli.bench import tick as run

    run(ticks, solver, json)


@commands.command("loop")
def bench_loop(
    cell: CellKind = "realtime",
    seconds: Annotated[float, typer.Option(help="Length of the run.", min=6.0)] = 20.0,
    log: LogOut = None,
    json: Json = False,
) -> None:
    """The whole loop: both arms grab and hold a box, controlled, judged and logged."""
    from rtstack.cli.bench import loop as run

    run(cell, seconds, log, json)


@commands.command("link")
def bench_link(
    cell: Annotated[str, typer.Option(help="lockstep, realtime or fci:LEFT,RIGHT.")] = "lockstep",
    ticks: Annotated[int, typer.Option(help="Milliseconds of the robot.", min=200)] = 3000,
    json: Json = False,
) -> None:
    """The way from a state to its answer to the next state, over the wire, with both arms."""
    from rtstack.cli.bench import link as run

    run(cell, ticks, json)
