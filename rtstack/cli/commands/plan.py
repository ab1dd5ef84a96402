"""The command that plans a reference."""

from pathlib import Path
from typing import Annotated

import typer

from rtstack.cli.commands.options import CellFile, Json, ObjectName
from rtstack.references.motion import Motion

commands = typer.Typer()


@commands.command()
def plan(
    output: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="The reference to write.")],
    motion: Annotated[Motion, typer.Option(help="Both arms lift the object, or the left one pushes it.")] = Motion.GRAB,
    object_name: ObjectName = "rice_box",
    speed: Annotated[
        float | None,
        typer.Option(
            metavar="M/S", help="Of the pads along y when they hit, 0.05 to 0.8; less if need be: 0.35, of a push 0.5."
        ),
    ] = None,
    rise: Annotated[
        float | None, typer.Option(metavar="M/S", help="Of a grab's pads upwards when they hit, 0.05 to 0.8: 0.25.")
    ] = None,
    height: Annotated[
        float | None, typer.Option(metavar="M", help="Of the pads over the object's centre: 0.02, of a push 0.")
    ] = None,
    posture: Annotated[
        float | None, typer.Option(metavar="RAD", help="Joint 1 at the impact, from home, -1.5 to 1.5: 0.")
    ] = None,
    squeeze: Annotated[
        float | None, typer.Option(metavar="N", help="Force of each of a grab's pads, up to 120: 40.")
    ] = None,
    lift: Annotated[float | None, typer.Option(metavar="M", help="How high a grab lifts, up to 0.5: 0.25.")] = None,
    lift_s: Annotated[float | None, typer.Option(metavar="S", help="How long the lift takes, up to 10: 1.2.")] = None,
    momentum_s: Annotated[
        float | None,
        typer.Option(metavar="S", help="How long a grab is lifted by momentum alone after the impact, up to 0.2: 0.1."),
    ] = None,
    carry: Annotated[
        float | None, typer.Option(metavar="M", help="How far a grab carries along x, -0.5 to 0.5: 0.05.")
    ] = None,
    travel: Annotated[float | None, typer.Option(metavar="M", help="How far a push goes, up to 0.5: 0.25.")] = None,
    inertia: Annotated[
        str | None, typer.Option(metavar="WHICH", help="Of the motors in the map, B, none or B_theta: B_theta.")
    ] = None,
    post_impact_scale: Annotated[
        float | None, typer.Option(metavar="FACTOR", help="A wrong post-impact velocity on purpose, 0.5 to 1.5: 1.")
    ] = None,
    watch: Annotated[
        int | None,
        typer.Option(metavar="RUNS", help="Make its monitor too, from so many simulated runs of it.", min=9, max=100),
    ] = None,
    cell_file: CellFile = None,
    json: Json = False,
) -> None:
    """Plan a reference without a demonstration: paths before and after the impact, joined by the impact map.

    The default of an option follows its colon.
    """
    from rtstack.cli.plan import run

    run(
        output, motion, object_name, cell_file, json, watch, speed=speed, rise=rise, height=height, posture=posture,
        squeeze=squeeze, lift=lift, lift_s=lift_s, momentum_s=momentum_s, carry=carry, travel=travel, inertia=inertia,
        post_impact_scale=post_impact_scale,
    )  # fmt: skip
