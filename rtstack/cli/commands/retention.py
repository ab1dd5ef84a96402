"""`rtstack logs`: what may go, and backups."""

from pathlib import Path
from typing import Annotated

import typer

commands = typer.Typer(help="What may go of the logs, and backups of their catalogue.")
LogFolder = Annotated[Path, typer.Option("--logs", metavar="DIR", help="The folder of logs.")]


@commands.command("reviewed")
def logs_reviewed(logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap...")]) -> None:
    """Mark logs as reviewed: only these ever go."""
    from rtstack.cli.retention import reviewed as run

    run(logs)


@commands.command("prune")
def logs_prune(
    folder: LogFolder = Path("logs"),
    older_than: Annotated[float | None, typer.Option(metavar="DAYS", help="These go.", min=0.0)] = None,
    budget: Annotated[
        float | None, typer.Option(metavar="GB", help="Then the oldest go, until all fit.", min=0.0)
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List what would go.")] = False,
) -> None:
    """Remove reviewed logs by age and budget; never one that nobody has reviewed, nor an accepted reference."""
    from rtstack.cli.retention import prune as run

    run(folder, older_than, budget, dry_run)


@commands.command("backup")
def logs_backup(
    output: Annotated[Path, typer.Argument(metavar="BACKUP.sqlite", help="A new file, or a folder.")],
    folder: LogFolder = Path("logs"),
) -> None:
    """Write the catalogue and all marks to one file, and read it again."""
    from rtstack.cli.retention import backup as run

    run(folder, output)


@commands.command("restore")
def logs_restore(
    source: Annotated[Path, typer.Argument(metavar="BACKUP.sqlite")],
    folder: LogFolder = Path("logs"),
) -> None:
    """Put a backup of the catalogue back; the present one is kept beside it."""
    from rtstack.cli.retention import restore as run

    run(folder, source)
