"""Commands that answer a question with many runs or none: campaigns, the monitor, the impact map."""

from pathlib import Path
from typing import Annotated

import typer

from rtstack.cli.commands.options import CellFile, Json, Profile

commands = typer.Typer()


@commands.command()
def campaign(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="A plan in deploy/campaigns, such as reference-spreading.")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where references, logs, results and report go.")],
    quick: Annotated[bool, typer.Option("--quick", help="A sample of it, which takes some minutes.")] = False,
    workers: Annotated[int | None, typer.Option(help="Processes on this machine; one a CPU.", min=1, max=256)] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Use the workers of this Dask scheduler.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what is missing in DIR.")] = False,
    logs: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Keep references and logs there, not in DIR: s3://BUCKET/PREFIX."),
    ] = None,
    cell_file: CellFile = None,
    profile: Profile = None,
    data: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Measurements of others, for the campaign reality.")
    ] = None,
) -> None:
    """Run many trials and write what they show: figures, tables, and each claim with a verdict."""
    from rtstack.cli.campaign import campaign as run

    run(name, out, quick, workers, scheduler, resume, logs, cell_file, profile, data)


@commands.command("tune-monitor")
def tune_monitor(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap...", help="Good runs: trials that succeeded.")],
    out: Annotated[Path, typer.Option(metavar="TOML", help="The parameters to write.")],
    sensitivity: Annotated[
        float,
        typer.Option(help="How many times the worst good run's deviation is unexpected.", min=1.0, max=10.0),
    ] = 1.3,
    cell_file: CellFile = None,
    json: Json = False,
) -> None:
    """Find the aim-aware monitor's parameters from good runs of one object; a third is held out, and checked."""
    from rtstack.cli.monitor import tune_monitor as run

    run(logs, out, sensitivity, json, cell_file)


@commands.command("impact-map")
def impact_map(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.toml", help="A scene, such as deploy/impacts/grab.toml.")],
    reflected: Annotated[
        str | None, typer.Option(help="Inertia of the motors, B_theta, B or none; the default is the scene's.")
    ] = None,
    json: Json = False,
) -> None:
    """Say what velocity follows an impact: single step and converged, with impulses, energy and residuals."""
    from rtstack.cli.impact_map import run

    run(scene, reflected, json)


@commands.command()
def twin(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap...", help="Of one cell: `rtstack excite`, or any.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="The folder to write; it must not exist.")],
    unloaded: Annotated[
        list[Path], typer.Option(metavar="LOG.mcap", help="Of the same arms without the payload; may be repeated.")
    ] = [],  # noqa: B006
    held_out: Annotated[
        list[Path], typer.Option(metavar="LOG.mcap", help="To judge the twin on, never fitted; may be repeated.")
    ] = [],  # noqa: B006
    cell_file: CellFile = None,
) -> None:
    """Identify both arms from their logs: a profile of the simulated robot, a friction, and what remains unknown."""
    from rtstack.cli.twin import run

    run(logs, out, unloaded, held_out, cell_file)
