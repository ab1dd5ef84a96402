"""Commands about one log."""

from pathlib import Path
from typing import Annotated

import typer

from rtstack.cli.commands.options import Json

commands = typer.Typer()


@commands.command()
def review(
    log: Annotated[Path, typer.Argument(metavar="LOG.mcap")],
    json: Json = False,
) -> None:
    """Say what is in a log: result, events, impacts, recomputed from its samples."""
    from rtstack.cli.logs import review as run

    run(log, json)


@commands.command()
def recover(log: Annotated[Path, typer.Argument(metavar="LOG.mcap")]) -> None:
    """Make a complete log of one that was cut off. The original stays as it is."""
    from rtstack.cli.logs import recover as run

    run(log)
