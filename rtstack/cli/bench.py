"""`rtstack bench`: what this machine makes of the stack."""

import json as json_module

import typer

from rtstack.bench.tick import bench_tick
from rtstack.cli.cells import load_description
from rtstack.samples import QpSolver
from rtstack.trials.assembly import default_parameters


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
    from rtstack.cli.cells import open_cell

    cell = open_cell(cell_kind, "rice_box", 0.0, 0)
    try:
        _print(bench_link(cell, ticks).as_dict(), json)
    finally:
        cell.close()


def _print(values: dict[str, object], json: bool) -> None:
    if json:
        typer.echo(json_module.dumps(values))
        return
    width = max(len(name) for name in values)
    for name, value in values.items():
        typer.echo(f"{name:<{width}}  {value}")
