"""`rtstack export`: logs as a data set for learning code. `rtstack import`: an episode of one as a log."""

import json as json_module
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from rtstack.cli.options import Json
from rtstack.cli.progress import progress_bar
from rtstack.log.errors import LogError

if TYPE_CHECKING:
    from rtstack.datasets.export import Format

commands = typer.Typer()


@commands.command()
def export(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap...", help="Each becomes an episode.")],
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="A folder for lerobot and zarr, a file for hdf5; it must not exist.")
    ],
    to: Annotated[Literal["lerobot", "hdf5", "zarr"], typer.Option("--to", help="The form of the data set.")],
    fps: Annotated[int, typer.Option(help="lerobot, zarr: frames in a second, a divisor of 1000.")] = 50,
    no_ticks: Annotated[bool, typer.Option("--no-ticks", help="lerobot, zarr: without the 1 kHz samples.")] = False,
    json: Json = False,
) -> None:
    """Make a data set of logs, for learning code. An export that was interrupted goes on where it ended."""
    from rtstack.datasets.export import export as write_data_set
    from rtstack.datasets.hdf5 import Hdf5
    from rtstack.datasets.lerobot import LeRobot
    from rtstack.datasets.zarr import Zarr

    if to == "hdf5" and no_ticks:
        raise LogError("--no-ticks is of lerobot and zarr: hdf5 has every sample")
    form: Format = Hdf5() if to == "hdf5" else {"lerobot": LeRobot, "zarr": Zarr}[to](fps, not no_ticks)
    began_s = time.perf_counter()
    with progress_bar("exporting", not json) as progress:
        done = write_data_set(logs, out, form, progress)
    took_s = time.perf_counter() - began_s
    if json:
        typer.echo(json_module.dumps({**asdict(done), "took_s": took_s, "out": str(out)}))
        return
    left = f", {done.present} of them were there" if done.present else ""
    faster = f"; {done.robot_s:.0f} s of robot's time in {took_s:.1f} s" if done.robot_s else ""
    typer.echo(f"wrote {out}: {done.episodes} episodes{left}{faster}")


@commands.command("import")
def import_dataset(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="Made by `rtstack export --to lerobot`.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.mcap")],
    episode: Annotated[int, typer.Option(help="Its number, from 0.")] = 0,
) -> None:
    """Make a log of an episode, to be played on the arms (`rtstack play`) or looked at."""
    from rtstack.datasets.lerobot_import import import_episode
    from rtstack.log.writer import check_log_path

    check_log_path(out)
    duration_s = import_episode(dataset, episode, out)
    typer.echo(f"wrote {out}: episode {episode} of {dataset}, {duration_s:.2f} s")
