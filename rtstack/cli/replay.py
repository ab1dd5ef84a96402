"""`rtstack replay`: the states of logs through the present controller, and a table of what it makes of them now."""

import json as json_module
from pathlib import Path

import typer

from rtstack.playback.replay import Replay, replay

FAILED = 1
SHOWN = 12  # fields in the table


def run(logs: list[Path], json: bool) -> None:
    """Replay logs one after another. Exits with 1 where one differs."""
    found = [replay(path) for path in logs]
    for each in found:
        typer.echo(json_module.dumps(each.as_dict()) if json else "\n".join(_lines(each)))
    if not all(each.same for each in found):
        raise typer.Exit(FAILED)


def _lines(found: Replay) -> list[str]:
    head = f"{found.log}: {found.kind}, {found.ticks} ticks: "
    if found.same:
        return [head + "every bit of what controller and judge make of them is the same"]
    logged, now = found.commits
    if found.replayed_ticks != found.ticks:
        head += f"the replay ended after {found.replayed_ticks}; "
    if not found.differences:
        return [head + "no field differs until then"]
    first = found.differences[0]
    lines = [
        f"{head}{first.side} {first.field} is the first to differ, in tick {first.first_tick}: {first.logged!r} in the "
        f"log, {first.replayed!r} now (commit {logged[:12]} then, {now[:12]} now)",
        f"{'arm':<6}{'field':<24}{'ticks':>7}{'first':>7}{'in the log':>14}{'now':>14}{'largest diff.':>15}",
    ]
    lines += [
        f"{d.side:<6}{d.field:<24}{d.ticks:>7}{d.first_tick:>7}{d.logged:>14.6g}{d.replayed:>14.6g}{d.largest:>15.3g}"
        for d in found.differences[:SHOWN]
    ]
    more = len(found.differences) - SHOWN
    return lines + [f"and {more} fields more"] * (more > 0)
