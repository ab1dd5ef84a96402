"""Commands that move arms: a demonstration, a trial, a playback, the runs that show friction; and by a hand on them."""

from pathlib import Path
from typing import Annotated

import typer

from rtstack.cli.commands.options import (
    CellFile,
    CellKind,
    ControllerChoice,
    Faults,
    Json,
    LogOut,
    ObjectName,
    Profile,
    Seed,
    ShiftX,
    ShiftY,
    Yaw,
)
from rtstack.samples import Reaction
from rtstack.trials.controllers import DEFAULT
from rtstack.trials.specification import DemonstrationSpecification, TrialSpecification

commands = typer.Typer()


@commands.command()
def demo(
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="A new folder, for both logs.")] = Path("demo"),
    browser: Annotated[bool, typer.Option(help="Open the impact's page, where there is a display.")] = True,
) -> None:
    """The whole way once, simulated: a demonstration, a trial of it with the object displaced, its review."""
    from rtstack.cli.demo import run

    run(out, browser)


@commands.command()
def teach(
    output: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="The recording to write.")],
    object_name: ObjectName = "rice_box",
    variation: Annotated[int, typer.Option(help="Number of the demonstration.", min=0)] = 0,
    seed: Seed = 0,
    speed: Annotated[
        float | None,
        typer.Option(help="Speed of the pads at the object, m/s, if not the variation's.", min=0.1, max=0.6),
    ] = None,
    cell: CellKind = "direct",
    profile: Profile = None,
    cell_file: CellFile = None,
    json: Json = False,
) -> None:
    """Record a scripted demonstration through the teleoperation path."""
    from rtstack.cells import with_profile
    from rtstack.cli.trials import teach as run

    asked = DemonstrationSpecification(object_name, variation, seed, speed)
    run(output, asked, with_profile(cell, profile), cell_file, json)


@commands.command()
def trial(
    reference: Annotated[Path, typer.Option(metavar="REC.mcap", help="Made by `rtstack teach` or `rtstack plan`.")],
    controller: ControllerChoice = DEFAULT,
    object_name: Annotated[
        str | None, typer.Option("--object", help="An object of the cell; by default the reference's.")
    ] = None,
    displacement_mm: ShiftY = 0.0,
    displacement_x_mm: ShiftX = 0.0,
    yaw_deg: Yaw = 0.0,
    seed: Seed = 0,
    log: LogOut = None,
    cell: CellKind = "direct",
    profile: Profile = None,
    cell_file: CellFile = None,
    safety: Annotated[
        Path | None, typer.Option(metavar="FILE", help="TOML with a table [safety]: limits that this trial tightens.")
    ] = None,
    friction: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Friction, made by `rtstack identify-friction`.")
    ] = None,
    reaction: Annotated[
        Reaction, typer.Option(help="What an impact leads to that was not meant; continue: a mark in log and result.")
    ] = Reaction.CONTINUE,
    monitor: Annotated[
        Path | None, typer.Option(metavar="TOML", help="The monitor's parameters, made by `rtstack tune-monitor`.")
    ] = None,
    faults: Faults = None,
    whole_reference: Annotated[
        bool, typer.Option("--whole-reference", help="Attach the reference to the log; else it is named by its digest.")
    ] = False,
    json: Json = False,
) -> None:
    """Run one trial: follow a recording through the impact."""
    from rtstack.cells import with_profile
    from rtstack.cli.trials import trial as run

    asked = TrialSpecification(
        str(reference), controller, object_name or "", displacement_mm, seed, reaction=reaction,
        displacement_x_mm=displacement_x_mm, yaw_deg=yaw_deg,
    )  # fmt: skip
    run(
        asked, log, with_profile(cell, profile), cell_file, json, safety=safety, friction=friction, monitor=monitor,
        faults=faults, whole_reference=whole_reference,
    )  # fmt: skip


@commands.command()
def play(
    source: Annotated[Path, typer.Argument(metavar="LOG.mcap", help="A recording, or any other log of both arms.")],
    speed: Annotated[float, typer.Option(help="Times the log's own speed: 0.1 to 4, as far as limits allow.")] = 1.0,
    seed: Seed = 0,
    log: LogOut = None,
    cell: CellKind = "direct",
    profile: Profile = None,
    cell_file: CellFile = None,
    json: Json = False,
) -> None:
    """Play a log on the arms themselves, with a soft start and a soft stop; Ctrl-C brakes along the path."""
    from rtstack.cells import with_profile
    from rtstack.cli.playback import play as run

    run(source, speed, seed, log, with_profile(cell, profile), cell_file, json)


@commands.command()
def excite(
    output: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="The log to write.")],
    run: Annotated[int, typer.Option(help="Each has other phases.", min=0, max=1000)] = 0,
    cell: CellKind = "direct",
    profile: Profile = None,
    seed: Seed = 0,
    cell_file: CellFile = None,
) -> None:
    """Move all joints of both arms at once, in free space: what `rtstack twin` needs to identify them."""
    from rtstack.cells import with_profile
    from rtstack.cli.excite import excite as make

    make(output, with_profile(cell, profile), seed, cell_file, run)


@commands.command("identify-friction")
def identify_friction(
    output: Annotated[Path, typer.Argument(metavar="OUT.toml", help="The file to write; logs go beside it.")],
    cell: CellKind = "direct",
    profile: Profile = None,
    seed: Seed = 0,
    runs: Annotated[int, typer.Option(help="Runs of each joint.", min=1, max=20)] = 2,
    cell_file: CellFile = None,
) -> None:
    """Move one joint after the other, with the object out of the way, and write both arms' friction."""
    from rtstack.cells import with_profile
    from rtstack.cli.friction import identify_friction as run

    run(output, with_profile(cell, profile), seed, cell_file, runs)


@commands.command()
def guide(
    cell: CellKind = "direct",
    profile: Profile = None,
    seconds: Annotated[float | None, typer.Option(help="End after so many seconds.", min=0.1)] = None,
    cell_file: CellFile = None,
    json: Json = False,
) -> None:
    """Let a person move both arms by hand, also back from beyond a limit, until Ctrl-C or the key that is let go."""
    from rtstack.cells import with_profile
    from rtstack.cli.guide import guide as run

    run(with_profile(cell, profile), seconds, cell_file, json)


@commands.command()
def wiggle(
    side: Annotated[str, typer.Argument(metavar="left|right", help="Which arm, as the cell's file calls it.")],
    joint: Annotated[int, typer.Option(help="Which joint.", min=1, max=7)] = 1,
    cell: CellKind = "direct",
    profile: Profile = None,
    cell_file: CellFile = None,
) -> None:
    """Turn one joint of an arm by a degree and back, so that a person sees which one is the left arm."""
    from rtstack.cells import with_profile
    from rtstack.cli.calibrate import wiggle as run

    if side not in ("left", "right"):
        raise typer.BadParameter(f"{side}: left or right")
    run(side, joint, with_profile(cell, profile), cell_file)


@commands.command()
def calibrate(
    points: Annotated[Path, typer.Argument(metavar="POINTS.toml", help="What is touched; what was measured is kept.")],
    cell: Annotated[
        str | None, typer.Option(help="The arms that are led to the points still to be measured, as by `guide`.")
    ] = None,
    seconds: Annotated[float | None, typer.Option(help="Lead to each point for so long at most.", min=0.1)] = None,
    write: Annotated[bool, typer.Option("--write", help="Put the result into the cell's file.")] = False,
    cell_file: CellFile = None,
    json: Json = False,
) -> None:
    """Find bases, tracker, pads and payloads from points that the pads touch, and say how well."""
    from rtstack.cli.calibrate import run_calibrate as run

    run(points, cell, cell_file, seconds, write, json)
