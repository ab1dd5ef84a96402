"""`rtstack logs`: what there is, what is reviewed, and what may go."""

import time
from pathlib import Path
from typing import Annotated

import typer

from rtstack.cli.commands.options import FAILED, Json, LogFolder

commands = typer.Typer(help="List, compare and prune the logs of a folder.")
_GB = 1e9


@commands.command("list")
def logs_list(
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="WORD...", help="As in the page's filter: rice, seed:3."),
    ] = None,
    folder: LogFolder = Path("logs"),
    kind: Annotated[str, typer.Option(help="trial, demonstration, recording, plan, playback ...")] = "",
    outcome: Annotated[str, typer.Option(metavar="[any|success|failure|none]")] = "any",
    sort: Annotated[str, typer.Option(metavar="COLUMN", help="when, name, average_force_norm ...")] = "when",
    ascending: Annotated[bool, typer.Option("--ascending", help="The smallest first, or the oldest.")] = False,
    json: Json = False,
) -> None:
    """List logs that have every word somewhere in what is known of them, the newest first."""
    from rtstack.cli.log_folder import list_logs as run

    run(folder, " ".join(words or []), kind, outcome, sort, not ascending, json)


@commands.command("show")
def logs_show(log: Annotated[Path, typer.Argument(metavar="LOG.mcap")], json: Json = False) -> None:
    """Say what was set for a log, what came out, and which topics it has."""
    from rtstack.cli.log_folder import show as run

    run(log, json)


@commands.command("compare")
def logs_compare(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap LOG.mcap...")], json: Json = False
) -> None:
    """Say what was set differently for logs, and what came out of each."""
    from rtstack.cli.log_folder import compare as run

    run(logs, json)


@commands.command("reviewed")
def logs_reviewed(logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap...")]) -> None:
    """Mark logs as reviewed: only these ever go."""
    import getpass

    from rtstack.retention.marks import mark_reviewed

    for log in logs:
        mark_reviewed(log, getpass.getuser())
        typer.echo(f"{log}: reviewed, it may go when its time has come")


@commands.command("prune")
def logs_prune(
    folder: LogFolder = Path("logs"),
    older_than: Annotated[float | None, typer.Option(metavar="DAYS", help="These go.", min=0.0)] = None,
    budget: Annotated[
        float | None, typer.Option(metavar="GB", help="Then the oldest go, until all fit.", min=0.0)
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List what would go.")] = False,
) -> None:
    """Remove reviewed logs by age and budget; never one that was not reviewed, has a star, or is an accepted reference.

    What was deleted on the page Logs a week ago or earlier is removed for good, too.
    """
    from rtstack.log.catalogue import Catalogue
    from rtstack.log.errors import LogError
    from rtstack.retention.policy import DAY_S, plan_pruning
    from rtstack.retention.policy import prune as remove
    from rtstack.retention.trash import KEPT_DAYS, empty, trashed

    if older_than is None and budget is None:
        raise LogError("say what may go: --older-than DAYS, --budget GB, or both")
    older_s = None if older_than is None else older_than * DAY_S
    plan = plan_pruning(Catalogue(folder).entries(), time.time(), older_s, None if budget is None else budget * _GB)
    gone = list(plan.going) if dry_run else list(remove(plan))
    for entry in gone:
        age = (time.time() - entry.modified_s) / DAY_S
        typer.echo(f"{entry.path.name}: {entry.size_bytes / 1e6:.1f} MB, {age:.0f} days old")
    before_s = time.time() - KEPT_DAYS * DAY_S
    deleted = [each for each in trashed(folder) if each.deleted_s <= before_s] if dry_run else empty(folder, before_s)
    for each in deleted:
        typer.echo(f"{each.name}: {each.size_bytes / 1e6:.1f} MB, deleted {KEPT_DAYS:g} days ago or earlier")
    verb = "would go" if dry_run else "removed"
    typer.echo(f"{len(gone)} logs {verb}, {sum(entry.size_bytes for entry in gone) / _GB:.2f} GB; "
               f"{plan.kept_bytes / _GB:.2f} GB stay")  # fmt: skip
    if plan.over_bytes:
        typer.echo(
            f"rtstack: {plan.over_bytes / _GB:.2f} GB over the budget: {plan.unreviewed_bytes / _GB:.2f} GB are not "
            "reviewed, or accepted as references: review them (rtstack logs reviewed), or give them more room", err=True
        )  # fmt: skip
        raise typer.Exit(FAILED)
