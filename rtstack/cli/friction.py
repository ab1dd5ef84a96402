"""`rtstack identify-friction`: everything is checked before an arm moves; a run that is complete is not made again."""

from dataclasses import replace
from pathlib import Path

import typer

from hal.cell import Cell
from rtstack.cells import load_description, open_cell
from rtstack.cli.hold_to_run import HoldToRun
from rtstack.cli.interrupt import interruptible
from rtstack.cli.progress import progress_bar
from rtstack.identification.procedure import Identification, SweepRun, lowest_object, runs_of
from rtstack.log.errors import LogError
from rtstack.loop.watchdogs import Parent
from rtstack.model.cell_description import CellDescription
from rtstack.trials.errors import TrialError
from rtstack.trials.friction import ArmFriction, friction_toml
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.start_motion import start_motion

FAILED = 1


def identify_friction(output: Path, cell_kind: str, seed: int, cell_file: Path | None, runs: int) -> None:
    """Identify the friction of a cell's arms and write it to `output`, which must not exist yet.

    The logs of the runs are kept beside it, and what is missing of them is made when the command is given again.
    """
    description, source = load_description(cell_file)
    if output.suffix != ".toml":
        raise TrialError(f"{output}: a friction's file is a .toml")
    if output.exists():
        raise TrialError(f"{output} exists: choose another name, or remove it")
    if not output.parent.is_dir():
        raise TrialError(f"cannot write {output}: the folder {output.parent} does not exist")
    identification = Identification(description)
    logs = output.with_name(f"{output.stem}-logs")
    missing = [
        run for run in runs_of(lowest_object(description), runs, seed)
        if not identification.take_log(run, logs / run.file)
    ]  # fmt: skip
    hold = HoldToRun(cell_kind, description, source)
    logs.mkdir(exist_ok=True)
    with (
        interruptible() as stop,
        hold.held("friction identification", stop) as held,
        progress_bar("friction identification", True) as progress,
    ):
        for k, run in enumerate(missing):
            cell = open_cell(
                cell_kind, run.specification.object, 0.0, seed, description, noise_seed=_noise(run), cell_file=source
            )
            try:
                context = RunContext(stop=stop, watchdogs=(Parent(), *held))
                reason = _make(identification, run, cell, cell_kind, description, source, logs, context)
            finally:
                cell.close()
            if stop.stop_requested:
                typer.echo("rtstack: interrupted; give the same command again to go on", err=True)
                raise typer.Exit(FAILED)
            if reason is not None:
                typer.echo(f"rtstack: joint {run.specification.joint}: {reason}", err=True)
                raise typer.Exit(FAILED)
            if progress is not None:
                progress((k + 1) / len(missing))
    file = identification.file(description.name, seed)
    output.write_text(friction_toml(file), encoding="utf-8")
    for side, arm in (("left", file.left), ("right", file.right)):
        typer.echo(f"{side}: " + _line(arm))
    typer.echo(f"written: {output}; name it in the cell's file (joint_friction = {output.name!r}), or with --friction")


def _make(
    identification: Identification, run: SweepRun, cell: Cell, cell_kind: str, description: CellDescription,
    source: Path, logs: Path, context: RunContext,
) -> str | None:  # fmt: skip
    """Make one run; a log of one that was broken off is written over."""
    way = start_motion(cell, description, "")
    try:
        log = open_log(logs / run.file, run.specification, description, cell_kind, source, overwrite=True)
    except LogError as error:
        raise TrialError(str(error)) from None
    return identification.run(run, cell, replace(context, log=log), way)


def _noise(run: SweepRun) -> int:
    """The same robot, seen through other noise in each run."""
    return 1000 * run.specification.run + run.specification.joint


def _line(arm: ArmFriction) -> str:
    worst = max(range(len(arm.rms_nm)), key=lambda j: arm.rms_nm[j])
    return (
        f"p1 {' '.join(f'{p:.2f}' for p in arm.p1)} Nm; gravity off by "
        f"{1e2 * max(map(abs, arm.gravity_share)):.2f} % at most; "
        f"{arm.rms_nm[worst]:.3f} Nm rms left at most (joint {worst + 1})"
    )
