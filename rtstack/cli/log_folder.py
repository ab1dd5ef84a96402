"""`rtstack logs list`, `show` and `compare`: a folder of logs as the page Logs has it, in a terminal."""

import json as json_module
import time
from collections.abc import Sequence
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Any, TypeVar

import typer

from console.log_rows import LogRow, log_row
from console.review.difference import differences, settings
from console.review.search import FilterRefused, Outcome, SortKey, ordered, search
from rtstack.cli.tables import print_table
from rtstack.log.catalogue import Catalogue
from rtstack.log.errors import LogError
from rtstack.log.reader import read_log

_RESULTS = ("success", "failure_reason", "impact_verdict", "average_force_norm", "peak_force_norm", "max_lift_mm")
_NOT_SET = "-"
Choice = TypeVar("Choice", bound=StrEnum)


def list_logs(folder: Path, query: str, kind: str, outcome: str, sort: str, descending: bool, json: bool) -> None:
    """Print a row for each log that is looked for. Raises LogError."""
    wanted, key = _one_of(Outcome, outcome, "--outcome"), _one_of(SortKey, sort, "--sort")
    pairs = [(entry, log_row(entry, None)) for entry in Catalogue(folder).entries()]
    try:
        rows = search([pair for pair in pairs if kind in ("", pair[1].kind)], query, wanted)
    except FilterRefused as error:
        raise LogError(str(error)) from None
    rows = ordered(rows, key, descending)
    if json:
        typer.echo(json_module.dumps({"logs": [asdict(row) for row in rows]}))
        return
    columns = ("when", "name", "kind", "controller", "object", "y, mm", "outcome", "verdict", "force", "lift, mm", "MB")
    print_table(columns, map(_cells, rows), "no log matches" if query or kind else f"no logs in {folder}")


def _cells(row: LogRow) -> tuple[str, ...]:
    when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(row.when))
    words = (row.controller, row.object, _number(row.displacement_mm, 0), row.outcome, row.verdict)
    numbers = (_number(row.average_force_norm, 1), _number(row.max_lift_mm, 0), f"{row.size_bytes / 1e6:.1f}")
    return when, row.name, row.kind, *(word or "" for word in words), *numbers


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def show(path: Path, json: bool) -> None:
    """Print what is known of a log. Raises LogError."""
    log = read_log(path)
    counts = {topic: log.count(topic) for topic in log.topics}
    known = {"result": dict(log.metadata.get("result", {})), "settings": settings(log), "topics": counts}
    if json:
        whole = {"path": str(path), "duration_s": log.duration_s, "complete": log.complete, **known}
        typer.echo(json_module.dumps(whole))
        return
    typer.echo(f"{path}: {log.duration_s:.3f} s")
    for title, values in known.items():
        typer.echo(title)
        for name, value in values.items():
            typer.echo(f"  {name.removeprefix('trial.'):<44} {value}")


def compare(paths: Sequence[Path], json: bool) -> None:
    """Print what was set differently for logs, and their results. Raises LogError."""
    if len(paths) < 2:
        raise LogError("give two logs at least: they are compared with each other")
    logs = [read_log(path) for path in paths]
    rows = differences(logs)
    results = [(name, [log.metadata.get("result", {}).get(name) for log in logs]) for name in _RESULTS]
    if json:
        whole: dict[str, Any] = {"logs": list(map(str, paths)), "settings": dict(rows), "result": dict(results)}
        typer.echo(json_module.dumps(whole))
        return
    head = ("", *(log.path.name for log in logs))
    told = [(name, values) for name, values in results if any(value is not None for value in values)]
    print_table(head, ((name, *map(_said, values)) for name, values in told), "no results")
    print_table(
        ("set differently", *head[1:]),
        ((key.removeprefix("trial."), *map(_said, values)) for key, values in rows),
        "nothing was set differently",
    )


def _said(value: str | None) -> str:
    try:
        return f"{float(value or ''):.4g}"
    except ValueError:
        return _NOT_SET if value is None else value


def _one_of(kind: type[Choice], word: str, option: str) -> Choice:
    try:
        return kind(word)
    except ValueError:
        raise LogError(f"{option} {word}: choose one of {', '.join(kind)}") from None
