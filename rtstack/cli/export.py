"""`rtstack export`: logs as a data set for learning code. `rtstack import`: an episode of one as a log."""

import json as json_module
import time
from dataclasses import asdict
from pathlib import Path

import typer

from rtstack.cli.progress import progress_bar
from rtstack.datasets.export import Format, export
from rtstack.datasets.hdf5 import Hdf5
from rtstack.datasets.lerobot import LeRobot
from rtstack.datasets.lerobot_import import import_episode
from rtstack.datasets.zarr import Zarr
from rtstack.log.errors import LogError
from rtstack.log.writer import check_log_path


def run(kind: str, logs: list[Path], out: Path, fps: int, ticks: bool, json: bool) -> None:
    """Write the data set, and say how large it is."""
    if kind == "hdf5" and not ticks:
        raise LogError("--no-ticks is of lerobot and zarr: hdf5 has every sample")
    form: Format = Hdf5() if kind == "hdf5" else {"lerobot": LeRobot, "zarr": Zarr}[kind](fps, ticks)
    began_s = time.perf_counter()
    with progress_bar("exporting", not json) as progress:
        done = export(logs, out, form, progress)
    took_s = time.perf_counter() - began_s
    if json:
        typer.echo(json_module.dumps({**asdict(done), "took_s": took_s, "out": str(out)}))
        return
    left = f", {done.present} of them were there" if done.present else ""
    faster = f"; {done.robot_s:.0f} s of robot's time in {took_s:.1f} s" if done.robot_s else ""
    typer.echo(f"wrote {out}: {done.episodes} episodes{left}{faster}")


def import_one(dataset: Path, episode: int, out: Path) -> None:
    """Write the log of an episode."""
    check_log_path(out)
    duration_s = import_episode(dataset, episode, out)
    typer.echo(f"wrote {out}: episode {episode} of {dataset}, {duration_s:.2f} s")
