"""`rtstack excite`: a motion of all joints in free space, from whose logs `rtstack twin` identifies both arms."""

from pathlib import Path

import typer

from rtstack.cells import load_description, open_cell
from rtstack.cli.hold_to_run import HoldToRun
from rtstack.cli.interrupt import interruptible
from rtstack.identification.procedure import lowest_object, uncompensated
from rtstack.identification.sweep import all_joints
from rtstack.log.writer import check_log_path
from rtstack.loop.watchdogs import Parent
from rtstack.trials.assembly import arm_controllers
from rtstack.trials.motion import run_motion
from rtstack.trials.record import open_log
from rtstack.trials.run_context import RunContext
from rtstack.trials.specification import SweepSpecification
from rtstack.trials.start_motion import start_motion

FAILED = 1
ALL_JOINTS = 0  # of SweepSpecification


def excite(output: Path, cell_kind: str, seed: int, cell_file: Path | None, run: int) -> None:
    """Move all joints of both arms and write the log. run: each has other phases."""
    description, source = load_description(cell_file)
    check_log_path(output)
    parameters = uncompensated()
    plan = all_joints(description, arm_controllers(description, parameters), run)
    specification = SweepSpecification(lowest_object(description), ALL_JOINTS, run, seed)
    hold = HoldToRun(cell_kind, description, source)
    cell = open_cell(
        cell_kind, specification.object, 0.0, seed, description, noise_seed=1000 * run + seed, cell_file=source
    )
    try:
        way = start_motion(cell, description, "")
        with interruptible() as stop, hold.held("motion of all joints", stop) as held:
            log = open_log(output, specification, description, cell_kind, source, cell=cell)
            context = RunContext(log, stop=stop, watchdogs=(Parent(), *held))
            reason, columns = run_motion(plan, description, parameters, cell, context, way=way)
    finally:
        cell.close()
    if reason is not None:
        typer.echo(f"rtstack: {reason}", err=True)
        raise typer.Exit(FAILED)
    typer.echo(f"{output}: {columns.arm.shape[1] * 1e-3:.1f} s; `rtstack twin` reads it")
