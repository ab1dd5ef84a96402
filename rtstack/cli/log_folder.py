"""`rtstack logs`: what there is, what is reviewed, and what may go."""

import time
from dataclasses import asdict
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hal.base.shared import user_name
from rtstack.cli.exit_status import fail
from rtstack.cli.options import Json, LogFolder
from rtstack.cli.tables import print_table
from rtstack.log.errors import LogError
from rtstack.log_folder.remarks import mark_reviewed
from rtstack.log_folder.search import FilterRefused, Outcome, SortKey, ordered, search
from rtstack.log_folder.trash import KEPT_DAYS, empty, trashed

if TYPE_CHECKING:
    from rtstack.log_folder.log_rows import LogRow

commands = typer.Typer()
logs = typer.Typer(help="List, compare and prune the logs of a folder.")
commands.add_typer(logs, name="logs")
_GB = 1e9
_RESULTS = ("success", "failure_reason", "impact_verdict", "average_force_norm", "peak_force_norm", "max_lift_mm")


@logs.command("list")
def logs_list(
    words: Annotated[
        list[str] | None, typer.Argument(metavar="WORD...", help="As in the page's filter: rice, seed:3.")
    ] = None,
    folder: LogFolder = Path("logs"),
    kind: Annotated[str, typer.Option(help="trial, demonstration, recording, plan, playback ...")] = "",
    outcome: Annotated[Outcome, typer.Option(help="What came out.")] = Outcome.ANY,
    sort: Annotated[SortKey, typer.Option(help="The column that the list is sorted by.")] = SortKey.WHEN,
    ascending: Annotated[bool, typer.Option("--ascending", help="The smallest first, or the oldest.")] = False,
    json: Json = False,
) -> None:
    """List logs that have every word somewhere in what is known of them, the newest first."""
    from rtstack.log_folder.catalogue import Catalogue
    from rtstack.log_folder.log_rows import log_row

    if meant := next((word for word in words or [] if "/" in word and Path(word).is_dir()), None):
        raise LogError(f"{meant} is a folder, and words are searched for: use --logs {meant}")
    pairs = [(entry, log_row(entry, None)) for entry in Catalogue(folder).entries()]
    query = " ".join(words or [])
    try:
        rows = search([pair for pair in pairs if kind in ("", pair[1].kind)], query, outcome)
    except FilterRefused as error:
        raise LogError(str(error)) from None
    rows = ordered(rows, sort, not ascending)
    if json:
        typer.echo(dumps({"logs": [asdict(row) for row in rows]}))
        return
    columns = ("when", "name", "kind", "controller", "object", "y, mm", "outcome", "verdict", "force", "lift, mm", "MB")
    print_table(columns, map(_cells, rows), "no log matches" if query or kind else f"no logs in {folder}")


@logs.command("show")
def logs_show(log: Annotated[Path, typer.Argument(metavar="LOG.mcap")], json: Json = False) -> None:
    """Say what was set for a log, what came out, and which topics it has."""
    from rtstack.log.reader import read_log
    from rtstack.log_folder.difference import settings

    found = read_log(log)
    counts = {topic: found.count(topic) for topic in found.topics}
    known = {"result": dict(found.metadata.get("result", {})), "settings": settings(found), "topics": counts}
    if json:
        typer.echo(dumps({"path": str(log), "duration_s": found.duration_s, "complete": found.complete, **known}))
        return
    typer.echo(f"{log}: {found.duration_s:.3f} s")
    for title, values in known.items():
        typer.echo(title)
        for name, value in values.items():
            typer.echo(f"  {name.removeprefix('trial.'):<44} {value}")


@logs.command("compare")
def logs_compare(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap LOG.mcap...")], json: Json = False
) -> None:
    """Say what was set differently for logs, and what came out of each."""
    from rtstack.log.reader import read_log
    from rtstack.log_folder.difference import differences

    if len(logs) < 2:
        raise LogError("give two logs at least: they are compared with each other")
    found = [read_log(path) for path in logs]
    rows = differences(found)
    results = [(name, [log.metadata.get("result", {}).get(name) for log in found]) for name in _RESULTS]
    if json:
        typer.echo(dumps({"logs": list(map(str, logs)), "settings": dict(rows), "result": dict(results)}))
        return
    head = ("", *(log.path.name for log in found))
    told = [(name, values) for name, values in results if any(value is not None for value in values)]
    print_table(head, ((name, *map(_said, values)) for name, values in told), "no results")
    settings = ((key.removeprefix("trial."), *map(_said, values)) for key, values in rows)
    print_table(("set differently", *head[1:]), settings, "nothing was set differently")


@logs.command("reviewed")
def logs_reviewed(logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap...")]) -> None:
    """Mark logs as reviewed: only these ever go."""
    for log in logs:
        mark_reviewed(log, user_name())
        typer.echo(f"{log}: reviewed, it may go when its time has come")


@logs.command("prune")
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
    from rtstack.log_folder.catalogue import Catalogue
    from rtstack.log_folder.policy import DAY_S, plan_pruning
    from rtstack.log_folder.policy import prune as remove

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
        kept = f"{plan.unreviewed_bytes / _GB:.2f} GB are not reviewed, or accepted as references"
        todo = "review them (rtstack logs reviewed), or give them more room"
        fail(f"{plan.over_bytes / _GB:.2f} GB over the budget: {kept}: {todo}")


def _cells(row: "LogRow") -> tuple[str, ...]:
    when = time.strftime("%Y-%m-%d %H:%M:%SZ", time.gmtime(row.when))
    words = (row.controller, row.object, _number(row.displacement_mm, 0), row.outcome, row.verdict)
    numbers = (_number(row.average_force_norm, 1), _number(row.max_lift_mm, 0), f"{row.size_bytes / 1e6:.1f}")
    return when, row.name, row.kind, *(word or "" for word in words), *numbers


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def _said(value: str | None) -> str:
    try:
        return f"{float(value or ''):.4g}"
    except ValueError:
        return "-" if value is None else value
