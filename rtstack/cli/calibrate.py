"""`rtstack guide` leads both arms by hand, `rtstack calibrate` to points that the pads touch; `rtstack wiggle`."""

import datetime
import json as json_module
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import typer

from rtstack.cli.exit_status import fail
from rtstack.cli.options import CellFile, CellKind, Json, Profile, Sign
from rtstack.trials.errors import TrialError

if TYPE_CHECKING:
    from hal.cell import Cell
    from rtstack.calibration.points import Point
    from rtstack.model.cell_description import CellDescription

commands = typer.Typer()
LOOKS = 200  # states that a torque at rest is the mean of


@commands.command()
def guide(
    cell: CellKind = "direct",
    profile: Profile = None,
    seconds: Annotated[float | None, typer.Option(help="End after so many seconds.", min=0.1)] = None,
    cell_file: CellFile = None,
    sign: Sign = None,
    json: Json = False,
) -> None:
    """Let a person move both arms by hand, also back from beyond a limit, until Ctrl-C or the key that is let go."""
    from rtstack.cli.terminal import Terminal, report
    from rtstack.trials.move import PreparedGuide
    from rtstack.trials.specification import GuideSpecification

    host = Terminal.of(cell, profile, cell_file, "moving by hand", led=True)
    result = host.run(PreparedGuide(GuideSpecification(seconds), host.description))
    pads = dict(zip(host.description.sides, result.pads, strict=True))
    if sign is not None and result.success:
        host.sign("guide", sign, {f"{side} pad, m": str(list(pad)) for side, pad in pads.items()}, result.log)
    ended = "let go" if result.success else f"stopped: {result.failure_reason}"
    inside = f"{'both arms are' if len(pads) == 2 else 'the arm is'} inside the cell's limits"
    if result.beyond_after:
        inside = "still beyond a limit: the same command again leads on"
    places = [f"{side} pad at x {x:.4f}, y {y:.4f}, z {z:.4f} m" for side, (x, y, z) in pads.items()]
    report(result, json, "\n".join([f"{ended} | {inside}", *result.beyond_after, *places]))


@commands.command()
def wiggle(
    side: Annotated[Literal["left", "right"], typer.Argument(help="Which arm, as the cell's file calls it.")],
    joint: Annotated[int, typer.Option(help="Which joint.", min=1, max=7)] = 1,
    cell: CellKind = "direct",
    profile: Profile = None,
    cell_file: CellFile = None,
    sign: Sign = None,
) -> None:
    """Turn one joint of an arm by a degree and back, so that a person sees which one is the left arm."""
    from rtstack.cli.terminal import Terminal
    from rtstack.identification.sweep import PreparedWiggle
    from rtstack.trials.specification import SweepSpecification

    host = Terminal.of(cell, profile, cell_file, f"joint {joint} of the {side} arm by a degree", led=True)
    description = host.description
    if side not in description.sides:
        raise TrialError(f"the cell {description.name} has no {side} arm: it has {' and '.join(description.sides)}")
    result = host.run(PreparedWiggle(SweepSpecification("", joint, 0), description, description.sides.index(side)))
    if not result.success:
        fail(str(result.failure_reason))
    other = ": was it the other arm that moved, then exchange the addresses of [left] and [right], or the cables"
    done = f"joint {joint} of the {side} arm has turned by a degree and back"
    typer.echo(done + other * (len(description.sides) == 2))
    if sign is not None:
        typer.echo(f"Was it the {side} arm? y or n, and Enter: ", err=True, nl=False)
        if sys.stdin.readline().strip().lower() != "y":
            fail("not signed: exchange the addresses or the cables of both arms, then repeat")
        host.sign(f"wiggle {side}", sign, {"joint": joint, "answer": f"it was the {side} arm"})


@commands.command()
def calibrate(
    points: Annotated[Path, typer.Argument(metavar="POINTS.toml", help="What is touched; what was measured is kept.")],
    cell: Annotated[
        str | None, typer.Option(help="The arms that are led to the points still to be measured, as by `guide`.")
    ] = None,
    seconds: Annotated[float | None, typer.Option(help="Lead to each point for so long at most.", min=0.1)] = None,
    write: Annotated[bool, typer.Option("--write", help="Put the result into the cell's file.")] = False,
    cell_file: CellFile = None,
    sign: Sign = None,
    json: Json = False,
) -> None:
    """Find bases, tracker, pads and payloads from points that the pads touch, and say how well."""
    from rtstack.calibration.fit import CalibrationError
    from rtstack.calibration.points import check_arms, load_points, outcome
    from rtstack.calibration.points import write as write_cell_file
    from rtstack.cells import load_description
    from rtstack.cells.commissioning import sign as sign_step
    from rtstack.cli.tables import print_table

    description, source = load_description(cell_file, cell or "")
    known = load_points(points)
    try:
        check_arms(known, description)
    except CalibrationError as error:
        raise TrialError(f"{points}: {error}") from None
    missing = [name for name, point in known.items() if not point.measured(description.sides)]
    if missing and cell is None:
        raise TrialError(f"{points}: {', '.join(missing)} still to be measured: name the arms with --cell")
    if write and cell_file is None:
        raise TrialError("name the file that is to be written with --cell-file")
    if missing and cell is not None:
        known = _measured(points, known, missing, cell, description, source, seconds)
    try:
        found = outcome(known, description, datetime.date.today())
    except TrialError as error:
        raise TrialError(f"{points}: {error}") from None
    if json:
        typer.echo(json_module.dumps(found.document()))
    else:
        rows = [(name, f"{1e3 * away:.2f}", "") for name, away in found.fit.residuals.items()]
        rows += [(name, f"{1e3 * away:.2f}", "WRONG: left out") for name, away in found.fit.wrong.items()]
        print_table(("point", "off by, mm", ""), rows, "")
        values = [f"{'.'.join(key)} = {value}" for key, value in found.values.items()]
        typer.echo("\n".join([*values, *found.lines]))
    if found.refusal is not None:
        fail(found.refusal)
    if write:
        write_cell_file(source, found.values)
        if sign is not None:
            values = {".".join(key): str(value) for key, value in found.values.items()}
            sign_step("calibrate", sign, values, load_description(source)[0], source)
    if not json:
        typer.echo(f"written: {source}" if write else "nothing is written; --write puts it into the cell's file")


def _measured(
    path: Path, points: "dict[str, Point]", missing: list[str], kind: str, description: "CellDescription",
    source: Path, seconds: float | None,
) -> "dict[str, Point]":  # fmt: skip
    """Let a person lead the pads to each missing point, and write the file after each."""
    from rtstack.calibration.points import save_points
    from rtstack.cli.terminal import Terminal
    from rtstack.trials.move import PreparedGuide
    from rtstack.trials.specification import GuideSpecification

    points = dict(points)
    host = Terminal(kind, description, source, "", led=True)
    prepared = PreparedGuide(GuideSpecification(seconds), description)
    with host.kept_cell(prepared) as cell:
        for number, name in enumerate(missing, 1):
            while True:
                host.what = f"point {number} of {len(missing)}, {name}: {points[name].asked}"
                typer.echo(host.what, err=True)
                result = host.run(prepared)
                if not result.success:
                    raise TrialError(f"{name}: {result.failure_reason}; the points before it are in {path}")
                if _taken():
                    break
            points[name] = _looked_at(points[name], cell)
            save_points(path, points)
    return points


def _taken() -> bool:
    """Ask the person at the terminal, where there is one, whether the arms stand as they should."""
    if not sys.stdin.isatty():
        return True
    typer.echo("Enter: take it; r, Enter: lead the arms again; q, Enter: go on another time: ", err=True, nl=False)
    if (answer := sys.stdin.readline().strip().lower()) == "q":
        raise TrialError("the points so far are kept; the same command goes on with the others")
    return answer != "r"


def _looked_at(point: "Point", cell: "Cell") -> "Point":
    """Return the point as the arms stand now."""
    q, tau = np.zeros((2, len(cell.arms), 7))
    for _ in range(LOOKS):
        for side, arm in enumerate(cell.arms):
            state = arm.read()
            q[side] += state.q / LOOKS
            tau[side] += state.tau_ext_hat_filtered / LOOKS
    return point.taken(q, tau, cell.sides)
