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
    rerun: Annotated[bool, typer.Option("--rerun", help="Open it in Rerun's viewer instead.")] = False,
    rrd: Annotated[
        Path | None, typer.Option(metavar="OUT.rrd", help="Write it for Rerun instead, to be opened elsewhere.")
    ] = None,
) -> None:
    """Say what is in a log: result, events, impacts, recomputed from its samples."""
    from rtstack.cli.logs import review as run
    from rtstack.cli.logs import review_in_rerun

    if rerun or rrd is not None:
        review_in_rerun(log, rrd)
    else:
        run(log, json)


@commands.command()
def recover(log: Annotated[Path, typer.Argument(metavar="LOG.mcap")]) -> None:
    """Make a complete log of one that was cut off. The original stays as it is."""
    from rtstack.cli.logs import recover as run

    run(log)
