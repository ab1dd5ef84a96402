"""Commands about one log."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from rtstack.cli.commands.options import Json

commands = typer.Typer()


class DatasetKind(StrEnum):
    """Forms of a data set."""

    LEROBOT = "lerobot"
    HDF5 = "hdf5"
    ZARR = "zarr"


@commands.command()
def review(
    log: Annotated[Path, typer.Argument(metavar="LOG.mcap")],
    json: Json = False,
    rerun: Annotated[bool, typer.Option("--rerun", help="Open it in Rerun's viewer instead.")] = False,
    rrd: Annotated[
        Path | None, typer.Option(metavar="OUT.rrd", help="Write it for Rerun instead, to be opened elsewhere.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a figure instead, as `rtstack plot` does.")
    ] = None,
) -> None:
    """Say what is in a log: result, events, impacts, recomputed from its samples, and a small picture of the forces."""
    from rtstack.cli.logs import review as run
    from rtstack.cli.logs import review_in_rerun

    if plot is not None:
        from rtstack.cli.plot import plot as draw

        draw([str(log)], None, plot)
    elif rerun or rrd is not None:
        review_in_rerun(log, rrd)
    else:
        run(log, json)


@commands.command()
def replay(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap...", help="Trials, demonstrations, teleoperations.")],
    json: Json = False,
    twin: Annotated[
        str | None,
        typer.Option(
            metavar="PROFILE",
            help="Run the log's commands in this profile's plant: does its contact force come out within 10 %?",
        ),
    ] = None,
) -> None:
    """Give a log's states to the present controller: does it make the same of them, bit by bit? No arm moves."""
    from rtstack.cli.replay import run

    run(logs, json, twin)


@commands.command()
def plot(
    words: Annotated[
        list[str],
        typer.Argument(metavar="LOG.mcap [SIGNAL...] [LOG.mcap...]", help="Signals by name, or a part of it."),
    ],
    html: Annotated[
        bool, typer.Option("--html", help="A page with the values at the pointer; needs no network.")
    ] = False,
    pdf: Annotated[bool, typer.Option("--pdf", help="With fonts inside, for a paper.")] = False,
    png: Annotated[bool, typer.Option("--png", help="The default.")] = False,
    svg: Annotated[bool, typer.Option("--svg")] = False,
    webp: Annotated[bool, typer.Option("--webp", help="The arms as they moved; under 1 s ten times slower.")] = False,
    output: Annotated[Path | None, typer.Option(metavar="FILE", help="By default LOG.png, here.")] = None,
    start: Annotated[float | None, typer.Option("--from", metavar="S", help="After the first sample.")] = None,
    end: Annotated[float | None, typer.Option("--to", metavar="S", help="After the first sample.")] = None,
    impact: Annotated[bool, typer.Option("--impact", help="0.2 s before to 0.3 s after the first impact.")] = False,
    reference: Annotated[bool, typer.Option("--reference", help="Draw what is to be followed, too.")] = False,
    align: Annotated[bool, typer.Option(help="Several logs with their first impacts at one time.")] = True,
) -> None:
    """Draw curves of a log, or of up to five above each other; without signals the pads' forces and velocities."""
    from rtstack.cli.plot import plot as run

    kinds = [
        kind for kind, chosen in (("html", html), ("pdf", pdf), ("png", png), ("svg", svg), ("webp", webp)) if chosen
    ]
    if len(kinds) > 1:
        raise typer.BadParameter(f"--{kinds[0]} and --{kinds[1]}: give one of them")
    run(words, kinds[0] if kinds else None, output, start, end, impact, reference, align)


@commands.command()
def export(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap...", help="Each becomes an episode.")],
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="A folder for lerobot and zarr, a file for hdf5; it must not exist.")
    ],
    to: Annotated[DatasetKind, typer.Option("--to", help="The form of the data set.")],
    fps: Annotated[int, typer.Option(help="lerobot, zarr: frames in a second, a divisor of 1000.")] = 50,
    no_ticks: Annotated[bool, typer.Option("--no-ticks", help="lerobot, zarr: without the 1 kHz samples.")] = False,
    json: Json = False,
) -> None:
    """Make a data set of logs, for learning code. An export that was interrupted goes on where it ended."""
    from rtstack.cli.export import run

    run(to, logs, out, fps, not no_ticks, json)


@commands.command("import")
def import_dataset(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Made by `rtstack export --to lerobot`.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.mcap")],
    episode: Annotated[int, typer.Option(help="Its number, from 0.")] = 0,
) -> None:
    """Make a log of an episode, to be played on the arms (`rtstack play`) or looked at."""
    from rtstack.cli.export import import_one

    import_one(dataset, episode, out)


@commands.command()
def recover(log: Annotated[Path, typer.Argument(metavar="LOG.mcap")]) -> None:
    """Make a complete log of one that was cut off. The original stays as it is."""
    from rtstack.cli.logs import recover as run

    run(log)
