"""`rtstack identify-friction` and `rtstack excite`: runs in free space, from which arms are identified."""

from pathlib import Path
from typing import Annotated

import typer

from hal.base.files import write_whole
from rtstack.cli.exit_status import fail
from rtstack.cli.options import CellFile, CellKind, Profile, Seed, check_new
from rtstack.trials.errors import TrialError

commands = typer.Typer()
ALL_JOINTS = 0  # of SweepSpecification


@commands.command()
def excite(
    output: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="The log to write.")],
    run: Annotated[int, typer.Option(help="Each has other phases.", min=0, max=1000)] = 0,
    cell: CellKind = "direct",
    profile: Profile = None,
    seed: Seed = 0,
    cell_file: CellFile = None,
) -> None:
    """Move all joints of both arms at once, in free space: what `rtstack twin` needs to identify them."""
    from rtstack.cli.terminal import Terminal
    from rtstack.identification.procedure import lowest_object, uncompensated
    from rtstack.identification.sweep import all_joints
    from rtstack.trials.assembly import arm_controllers
    from rtstack.trials.move import PreparedMotion
    from rtstack.trials.specification import SweepSpecification

    host = Terminal.of(cell, profile, cell_file, "motion of all joints", log_path=output)
    description = host.description
    parameters = uncompensated(description)
    plan = all_joints(description, arm_controllers(description, parameters), run)
    specification = SweepSpecification(lowest_object(description), ALL_JOINTS, run, seed)
    result = host.run(PreparedMotion(specification, description, plan, parameters, 1000 * run + seed))
    if not result.success:
        fail(str(result.failure_reason))
    typer.echo(f"{output}: {result.columns.arm.shape[1] * 1e-3:.1f} s; `rtstack twin` reads it")


@commands.command("identify-friction")
def identify_friction(
    output: Annotated[Path, typer.Argument(metavar="OUT.toml", help="The file to write; logs go beside it.")],
    cell: CellKind = "direct",
    profile: Profile = None,
    seed: Seed = 0,
    runs: Annotated[int, typer.Option(help="Runs of each joint.", min=1, max=20)] = 2,
    cell_file: CellFile = None,
) -> None:
    """Move one joint after the other, with the object out of the way, and write both arms' friction."""
    from rtstack.cli.terminal import Terminal
    from rtstack.identification.procedure import Identification, lowest_object, runs_of, sweep_log
    from rtstack.loop.end import End
    from rtstack.trials.friction import friction_toml

    host = Terminal.of(cell, profile, cell_file, "friction identification")
    description = host.description
    if output.suffix != ".toml":
        raise TrialError(f"{output}: a friction's file is a .toml")
    check_new(output)
    identification = Identification(description)
    logs = output.with_name(f"{output.stem}-logs")
    missing = [  # an interrupted command keeps its logs, and is given again
        run for run in runs_of(lowest_object(description), runs, seed)
        if not identification.take_log(run, logs / sweep_log(run))
    ]  # fmt: skip
    host.check()
    logs.mkdir(exist_ok=True)
    for k, run in enumerate(missing, 1):  # the key is held for one run at a time, 17 s
        host.log_path, host.bar = logs / sweep_log(run), f"joint {run.joint}, {k} of {len(missing)}"
        result = host.run(identification.prepared(run))
        if not result.success and End.in_reason(result.failure_reason) in (End.STOP_REQUESTED, End.RELEASED):
            fail("interrupted; give the same command again to go on")
        if not result.success:
            fail(f"joint {run.joint}: {result.failure_reason}")
        identification.take(run.joint, result.columns)
    file = identification.file(description.name, seed)
    write_whole(output, friction_toml(file))
    for side, arm in (("left", file.left), ("right", file.right)):
        if arm is not None:
            worst = max(range(len(arm.rms_nm)), key=arm.rms_nm.__getitem__)
            typer.echo(
                f"{side}: p1 {' '.join(f'{p:.2f}' for p in arm.p1)} Nm; gravity off by "
                f"{1e2 * max(map(abs, arm.gravity_share)):.2f} % at most; "
                f"{arm.rms_nm[worst]:.3f} Nm rms left at most (joint {worst + 1})"
            )
    typer.echo(f"written: {output}; name it in the cell's file (joint_friction = {output.name!r}), or with --friction")
