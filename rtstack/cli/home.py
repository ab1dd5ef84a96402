"""`rtstack home`: where a trial of a new cell starts."""

import json as json_module
from pathlib import Path
from typing import Annotated

import typer

from rtstack.cli.options import Json

commands = typer.Typer()


@commands.command()
def home(
    cell_file: Annotated[Path, typer.Argument(metavar="CELL.toml", help="A cell; its homes may be missing or wrong.")],
    write: Annotated[bool, typer.Option("--write", help="Put the joints into the file.")] = False,
    json: Json = False,
) -> None:
    """Find where a trial starts: pads flat, clear of limits, table and other arm; or say why not."""
    from rtstack.calibration.points import write as write_cell_file
    from rtstack.model.cell_description import load_cell_description
    from rtstack.planning.home import find_home

    homes = {side: q.tolist() for side, q in find_home(load_cell_description(cell_file, homeless=True)).items()}
    if write:
        write_cell_file(cell_file, {(side, "home"): q for side, q in homes.items()})
    if json:
        typer.echo(json_module.dumps(homes))
        return
    typer.echo("\n".join(f"[{side}]\nhome = {q}" for side, q in homes.items()))
    typer.echo(f"written: {cell_file}" if write else "nothing is written; --write puts it into the file", err=True)
