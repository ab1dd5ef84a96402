"""`rtstack play`: a log on the arms themselves. Everything is checked before the cell is opened and a log is begun."""

from pathlib import Path

import typer

from rtstack.cells import load_description, open_cell
from rtstack.cli.hold_to_run import HoldToRun
from rtstack.cli.interrupt import Interrupt, interruptible
from rtstack.cli.progress import progress_bar
from rtstack.log.writer import check_log_path
from rtstack.loop.watchdogs import Parent
from rtstack.playback.run import NO_OBJECT, prepare_playback, run_playback, way_to_start
from rtstack.trials.record import open_log
from rtstack.trials.result import PlaybackResult
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import PlaybackSpecification

FAILED = 1


class _Softly:
    """Ctrl-C as a soft stop: the first one brakes along the path, a second one ends the program."""

    def __init__(self, interrupt: Interrupt) -> None:
        self._interrupt = interrupt

    @property
    def asked(self) -> bool:
        """See rtstack.playback.guide.SoftStop."""
        return self._interrupt.stop_requested


def play(
    source: Path, speed: float, seed: int, log_path: Path | None, cell_kind: str, cell_file: Path | None, json: bool
) -> None:
    """Play the log `source` on a cell's arms; without `log_path` nothing is written."""
    description, description_file = load_description(cell_file)
    if log_path is not None:
        check_log_path(log_path)
    prepared = prepare_playback(PlaybackSpecification(str(source), speed, seed), description)
    hold = HoldToRun(cell_kind, description, description_file)
    cell = open_cell(cell_kind, NO_OBJECT, 0.0, seed, description, cell_file=description_file)
    try:
        way = way_to_start(prepared, cell)
        with (
            interruptible() as stop,
            hold.held(f"playback of {source}", stop) as held,
            progress_bar(f"playing at {speed:g}x", not json and not cell.own_clocks) as progress,
        ):
            log = None
            if log_path is not None:
                log = open_log(log_path, prepared.specification, description, cell_kind, description_file, cell=cell)
            context = RunContext(log, progress=progress, watchdogs=(Parent(), *held))
            result = run_playback(prepared, cell, context, soft_stop=_Softly(stop), way=way)
    finally:
        cell.close()
    typer.echo(result.as_json() if json else _line(result))
    if not result.success:
        raise typer.Exit(FAILED)


def _line(result: PlaybackResult) -> str:
    outcome = "played" if result.success else f"failed: {result.failure_reason}"
    error = "" if result.largest_error_mm is None else f" | pads at most {result.largest_error_mm:.1f} mm off"
    return f"{outcome} | {result.played_s:.2f} of {result.duration_s:.2f} s at {result.speed:g}x{error}"
