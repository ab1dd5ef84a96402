"""`rtstack logs`: what is reviewed, what may go, and backups of the catalogue."""

import getpass
import time
from pathlib import Path

import typer

from rtstack.log.catalogue import Catalogue
from rtstack.log.errors import LogError
from rtstack.retention.backup import BEFORE, back_up
from rtstack.retention.backup import restore as restore_catalogue
from rtstack.retention.marks import mark_reviewed
from rtstack.retention.policy import DAY_S, plan_pruning
from rtstack.retention.policy import prune as remove

FAILED = 1
_GB = 1e9


def reviewed(logs: list[Path]) -> None:
    """Mark logs as reviewed. Raises LogError."""
    for log in logs:
        mark_reviewed(log, getpass.getuser())
        typer.echo(f"{log}: reviewed, it may go when its time has come")


def prune(folder: Path, older_than_days: float | None, budget_gb: float | None, dry_run: bool) -> None:
    """Remove reviewed logs; exit status 1 where the budget is missed all the same. Raises LogError."""
    if older_than_days is None and budget_gb is None:
        raise LogError("say what may go: --older-than DAYS, --budget GB, or both")
    older_s = None if older_than_days is None else older_than_days * DAY_S
    plan = plan_pruning(
        Catalogue(folder).entries(), time.time(), older_s, None if budget_gb is None else budget_gb * _GB
    )
    gone = list(plan.going) if dry_run else list(remove(plan))
    for entry in gone:
        age = (time.time() - entry.modified_s) / DAY_S
        typer.echo(f"{entry.path.name}: {entry.size_bytes / 1e6:.1f} MB, {age:.0f} days old")
    verb = "would go" if dry_run else "removed"
    typer.echo(f"{len(gone)} logs {verb}, {sum(entry.size_bytes for entry in gone) / _GB:.2f} GB; "
               f"{plan.kept_bytes / _GB:.2f} GB stay")  # fmt: skip
    if plan.over_bytes:
        typer.echo(
            f"rtstack: {plan.over_bytes / _GB:.2f} GB over the budget: {plan.unreviewed_bytes / _GB:.2f} GB are not "
            "reviewed, or accepted as references: review them (rtstack logs reviewed), or give them more room", err=True
        )  # fmt: skip
        raise typer.Exit(FAILED)


def backup(folder: Path, output: Path) -> None:
    """Back the catalogue up. Raises LogError."""
    typer.echo(f"{back_up(folder, output)}: written, read again, the same")


def restore(folder: Path, source: Path) -> None:
    """Restore the catalogue. Raises LogError."""
    entries, marks = restore_catalogue(folder, source)
    typer.echo(f"{entries} logs and {marks} marks restored; what was there before: {folder / BEFORE}")
