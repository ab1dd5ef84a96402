"""`rtstack guide`: both arms by hand, for as long as the key is held."""

from pathlib import Path

import typer

from rtstack.cells import load_description, open_cell
from rtstack.cli.hold_to_run import HoldToRun
from rtstack.cli.interrupt import interruptible
from rtstack.loop.watchdogs import Parent
from rtstack.playback.run import NO_OBJECT
from rtstack.samples import SIDES
from rtstack.trials.guide import run_guide
from rtstack.trials.result import GuideResult
from rtstack.trials.run_context import RunContext

FAILED = 1


def guide(cell_kind: str, seconds: float | None, cell_file: Path | None, json: bool) -> None:
    """Recover both arms and let them be moved; exit status 1 where the judge stopped them. Writes nothing."""
    description, source = load_description(cell_file)
    hold = HoldToRun(cell_kind, description, source, led=True)
    cell = open_cell(cell_kind, NO_OBJECT, 0.0, 0, description, cell_file=source, led=True)
    try:
        with interruptible() as stop, hold.held("moving by hand", stop) as held:
            result = run_guide(description, cell, RunContext(stop=stop, watchdogs=(Parent(), *held)), seconds)
    finally:
        cell.close()
    if json:
        typer.echo(result.as_json())
    else:
        for line in _lines(result):
            typer.echo(line)
    if not result.success:
        raise typer.Exit(FAILED)


def _lines(result: GuideResult) -> list[str]:
    ended = "let go" if result.success else f"stopped: {result.failure_reason}"
    inside = "both arms are inside the cell's limits"
    if result.beyond_after:
        inside = "still beyond a limit: the same command again leads on"
    pads = [
        f"{side} pad at x {x:.4f}, y {y:.4f}, z {z:.4f} m" for side, (x, y, z) in zip(SIDES, result.pads, strict=True)
    ]
    return [f"{ended} | {inside}", *result.beyond_after, *pads]
