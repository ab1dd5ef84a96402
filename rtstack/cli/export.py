"""`rtstack export`: logs as a data set for learning code. `rtstack import`: an episode of one as a log."""

import json as json_module
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from rtstack.cli.options import Json
from rtstack.cli.progress import progress_bar
from rtstack.cli.tables import print_table
from rtstack.log.errors import LogError

if TYPE_CHECKING:
    from rtstack.datasets.episode import Candidate

commands = typer.Typer()
_FILTER = (
    "As in `rtstack logs list` and on the page Logs: 'object=rice_box tag=good operator=anna verdict=kept "
    "date>=2026-11-26 date<2026-11-27T08:30' (UTC)."
)


@commands.command()
def export(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG.mcap...", help="Logs, and folders of logs: an episode each.")
    ],
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="A folder for lerobot and zarr, a file for hdf5; it must not exist.")
    ],
    to: Annotated[Literal["lerobot", "hdf5", "zarr"], typer.Option("--to", help="The form of the data set.")],
    words: Annotated[str, typer.Option("--filter", metavar="WORDS", help=_FILTER)] = "",
    failed: Annotated[bool, typer.Option("--failed", help="Take runs that failed or have no result, too.")] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="List what would be taken, and why not. Write nothing.")
    ] = False,
    fps: Annotated[int, typer.Option(help="lerobot, zarr: frames in a second, a divisor of 1000.")] = 50,
    no_ticks: Annotated[bool, typer.Option("--no-ticks", help="lerobot, zarr: without the 1 kHz samples.")] = False,
    video: Annotated[bool, typer.Option("--video", help="lerobot: pictures as films of H.264.")] = False,
    json: Json = False,
) -> None:
    """Make a data set of logs, for learning code. An export that was interrupted goes on where it ended.

    Runs that were discarded, failed, or have no result are left out unless the filter asks for a verdict or success.
    """
    from rtstack.datasets.export import NothingToExport
    from rtstack.datasets.export import export as write_data_set
    from rtstack.datasets.hdf5 import Hdf5
    from rtstack.datasets.lerobot import LeRobot
    from rtstack.datasets.zarr import Zarr

    if to == "hdf5" and no_ticks:
        raise LogError("--no-ticks is of lerobot and zarr: hdf5 has every sample")
    if to != "lerobot" and video:
        raise LogError("--video is of lerobot: zarr has pictures as arrays, hdf5 has none")
    form = Hdf5() if to == "hdf5" else Zarr(fps, not no_ticks) if to == "zarr" else LeRobot(fps, not no_ticks, video)
    began_s = time.perf_counter()
    try:
        with progress_bar("exporting", not json) as progress:
            done = write_data_set(logs, out, form, progress, query=words, failed=failed, dry_run=dry_run)
    except NothingToExport as error:
        if len(error.candidates) > 1:
            _say_left_out(error.candidates)
        raise
    took_s = time.perf_counter() - began_s
    if json:
        known = {"episodes": done.episodes, "present": done.present, "robot_s": done.robot_s, "took_s": took_s}
        told = [{"log": str(each.path), "why": each.why} for each in done.candidates]
        typer.echo(json_module.dumps({**known, "out": str(out), "dry_run": dry_run, "logs": told}))
        return
    if dry_run:
        columns = ("log", "UTC", "kind", "controller", "object", "verdict", "taken")
        print_table(columns, map(_cells, done.candidates), "no logs")
        typer.echo(f"would write {out}: {_counted(done.candidates)}; nothing was written")
        return
    _say_left_out(done.candidates)
    left = f", {done.present} of the episodes were there" if done.present else ""
    faster = f"; {done.robot_s:.0f} s of robot's time in {took_s:.1f} s" if done.robot_s else ""
    typer.echo(f"wrote {out}: {_counted(done.candidates)}{left}{faster}")


def _counted(candidates: "Sequence[Candidate]") -> str:
    taken = sum(not each.why for each in candidates)
    return f"{taken} episode{'' if taken == 1 else 's'}, {len(candidates) - taken} left out"


def _say_left_out(candidates: "Sequence[Candidate]") -> None:
    """Print a line for each log that cannot be an episode, and how many the filters have left out."""
    for each in candidates:
        if each.wrong:
            typer.echo(f"rtstack: left out {each.path}: {each.why}", err=True)
    for why, count in Counter(each.why for each in candidates if each.why and not each.wrong).most_common():
        typer.echo(f"rtstack: left out {count}: {why}", err=True)


def _cells(candidate: "Candidate") -> tuple[str, ...]:
    names = ("kind", "controller", "object", "episode_verdict")
    words = [str(getattr(candidate.row, name, None) or "") for name in names]
    taken = f"no: {candidate.why}" if candidate.why else "yes"
    return candidate.path.name, (candidate.recorded or "")[:19], *words, taken


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
