"""`rtstack calibrate` and `rtstack wiggle`: where everything in a cell is, from points that the pads are led to."""

import datetime
import json as json_module
import sys
from pathlib import Path

import numpy as np
import typer

from hal.cell import Cell
from rtstack.calibration.cell_file import write
from rtstack.calibration.outcome import Outcome, outcome
from rtstack.calibration.points import Point, load_points, save_points
from rtstack.cells import load_description, open_cell
from rtstack.cli.hold_to_run import HoldToRun
from rtstack.cli.interrupt import interruptible
from rtstack.cli.tables import print_table
from rtstack.identification.sweep import wiggle as wiggle_plan
from rtstack.loop.watchdogs import Parent
from rtstack.model.cell_description import CellDescription
from rtstack.playback.run import NO_OBJECT
from rtstack.samples import SIDES
from rtstack.trials.assembly import arm_controllers, cell_parameters
from rtstack.trials.errors import TrialError
from rtstack.trials.guide import run_guide, where_arms_stand
from rtstack.trials.motion import run_motion
from rtstack.trials.run_context import RunContext

FAILED = 1
LOOKS = 200  # states that a torque at rest is the mean of


def wiggle(side: str, joint: int, cell_kind: str, cell_file: Path | None) -> None:
    """Turn one joint (1 to 7) of the arm that the cell's file calls `side` by a degree and back, where it stands."""
    description, source = load_description(cell_file)
    hold = HoldToRun(cell_kind, description, source, led=True)
    cell = open_cell(cell_kind, NO_OBJECT, 0.0, 0, description, cell_file=source, led=True)
    try:
        with interruptible() as stop, hold.held(f"joint {joint} of the {side} arm by a degree", stop) as held:
            parameters = cell_parameters(description)
            q = where_arms_stand(description, cell).q
            plan = wiggle_plan(arm_controllers(description, parameters), q, SIDES.index(side), joint - 1)
            context = RunContext(stop=stop, watchdogs=(Parent(), *held))
            reason, _ = run_motion(plan, description, parameters, cell, context)
    finally:
        cell.close()
    if reason is not None:
        typer.echo(f"rtstack: {reason}", err=True)
        raise typer.Exit(FAILED)
    typer.echo(
        f"joint {joint} of the {side} arm has turned by a degree and back: was it the other arm that moved, then "
        "exchange the addresses of [left] and [right], or the cables"
    )


def run_calibrate(
    path: Path, cell_kind: str | None, cell_file: Path | None, seconds: float | None, into_file: bool, json: bool
) -> None:
    """Measure what is missing of the points, fit, print, and write; exit status 1 where the result is too coarse."""
    description, source = load_description(cell_file)
    points = load_points(path)
    missing = [name for name, point in points.items() if not point.measured]
    if missing and cell_kind is None:
        raise TrialError(f"{path}: {', '.join(missing)} still to be measured: name the arms with --cell")
    if into_file and cell_file is None:
        raise TrialError("name the file that is to be written with --cell-file")
    if missing and cell_kind is not None:
        points = _measured(path, points, missing, cell_kind, description, source, seconds)
    try:
        found = outcome(points, description, datetime.date.today())
    except TrialError as error:
        raise TrialError(f"{path}: {error}") from None
    if json:
        typer.echo(json_module.dumps(found.document()))
    else:
        _print(found)
    if found.refusal is not None:
        typer.echo(f"rtstack: {found.refusal}", err=True)
        raise typer.Exit(FAILED)
    if into_file:
        write(source, found.values)
    if not json:
        typer.echo(f"written: {source}" if into_file else "nothing is written; --write puts it into the cell's file")


def _measured(
    path: Path, points: dict[str, Point], missing: list[str], cell_kind: str, description: CellDescription,
    source: Path, seconds: float | None,
) -> dict[str, Point]:  # fmt: skip
    """Let a person lead the pads to each missing point, and write the file after each."""
    points = dict(points)
    hold = HoldToRun(cell_kind, description, source, led=True)
    cell = open_cell(cell_kind, NO_OBJECT, 0.0, 0, description, cell_file=source, led=True)
    try:
        for number, name in enumerate(missing, 1):
            while True:
                what = f"point {number} of {len(missing)}, {name}: {points[name].asked}"
                typer.echo(what, err=True)
                with interruptible() as stop, hold.held(what, stop) as held:
                    context = RunContext(stop=stop, watchdogs=(Parent(), *held))
                    result = run_guide(description, cell, context, seconds)
                if not result.success:
                    raise TrialError(f"{name}: {result.failure_reason}; the points before it are in {path}")
                if _taken():
                    break
            points[name] = _looked_at(points[name], cell)
            save_points(path, points)
    finally:
        cell.close()
    return points


def _taken() -> bool:
    """Ask the person at the terminal, where there is one, whether the arms stand as they should."""
    if not sys.stdin.isatty():
        return True
    typer.echo("Enter: take it; r, Enter: lead the arms again; q, Enter: go on another time: ", err=True, nl=False)
    match sys.stdin.readline().strip().lower():
        case "q":
            raise TrialError("the points so far are kept; the same command goes on with the others")
        case answer:
            return answer != "r"


def _looked_at(point: Point, cell: Cell) -> Point:
    """Return the point as the arms stand now."""
    q, tau = np.zeros((2, 7)), np.zeros((2, 7))
    for _ in range(LOOKS):
        for side, arm in enumerate((cell.left, cell.right)):
            state = arm.read()
            q[side] += state.q / LOOKS
            tau[side] += state.tau_ext_hat_filtered / LOOKS
    return point.taken(q, tau)


def _print(found: Outcome) -> None:
    rows = [(name, f"{1e3 * away:.2f}", "") for name, away in found.fit.residuals.items()]
    rows += [(name, f"{1e3 * away:.2f}", "WRONG: left out") for name, away in found.fit.wrong.items()]
    print_table(("point", "off by, mm", ""), rows, "")
    for key, value in found.values.items():
        typer.echo(f"{'.'.join(key)} = {value}")
    for line in found.lines:
        typer.echo(line)
