"""`rtstack export`: logs as a data set for learning code."""

import json as json_module
import time
from dataclasses import asdict
from pathlib import Path

import typer

from rtstack.cli.progress import progress_bar
from rtstack.datasets.export import export
from rtstack.datasets.hdf5 import Hdf5


def run(logs: list[Path], out: Path, json: bool) -> None:
    """Write the data set, and say how large it is."""
    began_s = time.perf_counter()
    with progress_bar("exporting", not json) as progress:
        done = export(logs, out, Hdf5(), progress)
    took_s = time.perf_counter() - began_s
    if json:
        typer.echo(json_module.dumps({**asdict(done), "took_s": took_s, "out": str(out)}))
        return
    left = f", {done.present} of them were there" if done.present else ""
    faster = f"; {done.robot_s:.0f} s of robot's time in {took_s:.1f} s" if done.robot_s else ""
    typer.echo(f"wrote {out}: {done.episodes} episodes{left}{faster}")
