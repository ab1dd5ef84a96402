"""The commands. Each imports what it needs when it runs, so that `rtstack --help` answers at once."""

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from rtstack.references.motion import Motion
from rtstack.samples import QpSolver, Reaction
from rtstack.trials.specification import Controller

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Impact-aware dual-arm control: demonstrate, run, review.",
)
bench_app = typer.Typer(help="Measure the stack on this machine.")
app.add_typer(bench_app, name="bench")
token_app = typer.Typer(help="Let programs use the console: bearer tokens.")
app.add_typer(token_app, name="token")
logs_app = typer.Typer(help="What may go of the logs, and backups of their catalogue.")
app.add_typer(logs_app, name="logs")

BAD_INPUT = 2
FAILED = 1

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout, and nothing else.")]
CellFile = Annotated[Path | None, typer.Option("--cell-file", help="TOML description of the cell.")]
ObjectName = Annotated[str, typer.Option("--object", help="An object of the cell.")]
Logs = Annotated[Path, typer.Option(help="The folder of logs that `rtstack up` was given.")]
Seed = Annotated[int, typer.Option(help="Seed of noise, plant and placement.", min=0)]


@app.command()
def teach(
    output: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="The recording to write.")],
    object_name: ObjectName = "rice_box",
    variation: Annotated[int, typer.Option(help="Number of the demonstration.", min=0)] = 0,
    seed: Seed = 0,
    speed: Annotated[
        float | None,
        typer.Option(help="Speed of the pads at the object, m/s, if not the variation's.", min=0.1, max=0.6),
    ] = None,
    cell: Annotated[str, typer.Option(help="direct, lockstep, realtime or fci:LEFT,RIGHT.")] = "direct",
    cell_file: CellFile = None,
    json: Json = False,
) -> None:
    """Record a scripted demonstration through the teleoperation path."""
    from rtstack.cli.trials import teach as run

    run(output, object_name, variation, seed, speed, cell, cell_file, json)


@app.command()
def trial(
    reference: Annotated[Path, typer.Option(metavar="REC.mcap", help="Made by `rtstack teach` or `rtstack plan`.")],
    controller: Annotated[
        Controller, typer.Option(help="The proposed controller, a baseline, or contact_completion.")
    ] = Controller.PROPOSED,
    object_name: ObjectName = "rice_box",
    displacement_mm: Annotated[float, typer.Option(help="Shift of the object along y.")] = 0.0,
    seed: Seed = 0,
    log: Annotated[Path | None, typer.Option(metavar="OUT.mcap", help="The log to write.")] = None,
    cell: Annotated[str, typer.Option(help="direct, lockstep, realtime or fci:LEFT,RIGHT.")] = "direct",
    cell_file: CellFile = None,
    safety: Annotated[
        Path | None, typer.Option(metavar="FILE", help="TOML with a table [safety]: limits that this trial tightens.")
    ] = None,
    friction: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Friction, made by `rtstack identify-friction`.")
    ] = None,
    reaction: Annotated[
        Reaction, typer.Option(help="What an impact leads to that was not meant; continue: a mark in log and result.")
    ] = Reaction.CONTINUE,
    monitor: Annotated[
        Path | None, typer.Option(metavar="TOML", help="The monitor's parameters, made by `rtstack tune-monitor`.")
    ] = None,
    faults: Annotated[
        Path | None, typer.Option(metavar="FILE", help="TOML script of what goes wrong in a simulated cell.")
    ] = None,
    json: Json = False,
) -> None:
    """Run one trial: follow a recording through the impact."""
    from rtstack.cli.trials import trial as run

    run(
        reference, controller, object_name, displacement_mm, seed, log, cell, cell_file, json, safety, friction,
        reaction, monitor, faults,
    )  # fmt: skip


@app.command()
def play(
    source: Annotated[Path, typer.Argument(metavar="LOG.mcap", help="A recording, or any other log of both arms.")],
    speed: Annotated[float, typer.Option(help="Times the log's own speed: 0.1 to 4, as far as limits allow.")] = 1.0,
    seed: Seed = 0,
    log: Annotated[Path | None, typer.Option(metavar="OUT.mcap", help="The log to write.")] = None,
    cell: Annotated[str, typer.Option(help="direct, lockstep, realtime or fci:LEFT,RIGHT.")] = "direct",
    cell_file: CellFile = None,
    json: Json = False,
) -> None:
    """Play a log on the arms themselves, with a soft start and a soft stop; Ctrl-C brakes along the path."""
    from rtstack.cli.playback import play as run

    run(source, speed, seed, log, cell, cell_file, json)


@app.command("identify-friction")
def identify_friction(
    output: Annotated[Path, typer.Argument(metavar="OUT.toml", help="The file to write; logs go beside it.")],
    cell: Annotated[str, typer.Option(help="direct, lockstep, realtime or fci:LEFT,RIGHT.")] = "direct",
    seed: Seed = 0,
    runs: Annotated[int, typer.Option(help="Runs of each joint.", min=1, max=20)] = 2,
    cell_file: CellFile = None,
) -> None:
    """Move one joint after the other, with the object out of the way, and write both arms' friction."""
    from rtstack.cli.friction import identify_friction as run

    run(output, cell, seed, cell_file, runs)


@app.command()
def review(
    log: Annotated[Path, typer.Argument(metavar="LOG.mcap")],
    json: Json = False,
) -> None:
    """Say what is in a log: result, events, impacts, recomputed from its samples."""
    from rtstack.cli.logs import review as run

    run(log, json)


@app.command()
def recover(log: Annotated[Path, typer.Argument(metavar="LOG.mcap")]) -> None:
    """Make a complete log of one that was cut off. The original stays as it is."""
    from rtstack.cli.logs import recover as run

    run(log)


@app.command("recover-arms")
def recover_arms(
    cell: Annotated[str | None, typer.Option(help="fci:LEFT,RIGHT; by default the arms of the running stack.")] = None,
    stack: Annotated[
        Path | None, typer.Option(metavar="SOCKET", help="Which stack, where several are running.")
    ] = None,
) -> None:
    """Clear what the arms have latched (a fault, a reflex), once its cause is gone."""
    from rtstack.cli.recovery import recover_arms as run

    run(cell, stack)


@app.command()
def up(
    port: Annotated[int, typer.Option(help="Port of the console, on the loopback address.", min=0, max=65535)] = 8080,
    logs: Annotated[Path, typer.Option(help="Where logs are written.")] = Path("logs"),
    cell_file: Annotated[Path | None, typer.Option("--cell", help="TOML description of the cell.")] = None,
    left: Annotated[str | None, typer.Option(help="Address of the left arm.")] = None,
    right: Annotated[str | None, typer.Option(help="Address of the right arm.")] = None,
) -> None:
    """Start the whole stack, with the arms at --left and --right or the simulated cell; Ctrl-C ends all of it."""
    from rtstack.cli.stack import up as run

    run(port, logs, cell_file, left, right)


RunFolder = Annotated[Path, typer.Option("--run", metavar="DIR", help="Where robot process and console meet.")]


@app.command()
def robot(
    run_folder: RunFolder = Path("/run/rtstack"),
    logs: Annotated[Path, typer.Option(help="Where logs are written.")] = Path("logs"),
    cell_file: Annotated[Path | None, typer.Option("--cell", help="TOML description of the cell.")] = None,
    left: Annotated[str | None, typer.Option(help="Address of the left arm.")] = None,
    right: Annotated[str | None, typer.Option(help="Address of the right arm.")] = None,
) -> None:
    """Run the robot process alone, as a service does: cell, loop and logs; disarmed, until somebody arms."""
    from rtstack.cli.service import robot as run

    run(run_folder, logs, cell_file, left, right)


@app.command()
def console(
    run_folder: RunFolder = Path("/run/rtstack"),
    port: Annotated[int, typer.Option(help="Port of the console, on the loopback address.", min=0, max=65535)] = 8080,
    logs: Annotated[Path, typer.Option(help="Where logs are written.")] = Path("logs"),
    cell_file: Annotated[Path | None, typer.Option("--cell", help="TOML description of the cell.")] = None,
    left: Annotated[str | None, typer.Option(help="Address of the left arm.")] = None,
    right: Annotated[str | None, typer.Option(help="Address of the right arm.")] = None,
) -> None:
    """Run the console alone, beside `rtstack robot`, with the same options."""
    from rtstack.cli.service import console as run

    run(run_folder, port, logs, cell_file, left, right)


@app.command()
def sim(
    scene: Annotated[str, typer.Option(metavar="NAME", help="The scene to simulate: grab.")] = "grab",
    left: Annotated[str, typer.Option(metavar="ADDR", help="Address of the left arm.")] = "127.0.0.11",
    right: Annotated[str, typer.Option(metavar="ADDR", help="Address of the right arm.")] = "127.0.0.12",
    lockstep: Annotated[bool, typer.Option("--lockstep", help="Wait for every moving arm's answer.")] = False,
    seed: Seed = 0,
    object_name: ObjectName = "rice_box",
    displacement_mm: Annotated[float, typer.Option(help="Shift of the object along y.")] = 0.0,
    faults: Annotated[
        Path | None, typer.Option(metavar="FILE", help="TOML script of what goes wrong, and when.")
    ] = None,
    tracker: Annotated[
        str, typer.Option(metavar="HOST:PORT", help="Who is sent the object's poses (UDP).")
    ] = "127.0.0.1:1341",
    phase_us: Annotated[float, typer.Option(help="How much later the right arm's clock ticks.")] = 0.0,
    drift_ppm: Annotated[float, typer.Option(help="How much faster the right arm's clock runs.")] = 0.0,
    priority: Annotated[int, typer.Option(help="SCHED_FIFO priority, 0 for none.", min=0, max=99)] = 80,
    cpu: Annotated[
        int | None,
        typer.Option(help="CPU to stay on, -1 for any; by default the first, the loop takes the last.", min=-1),
    ] = None,
) -> None:
    """Serve the simulated arms at their addresses, as robots would be, until Ctrl-C."""
    from hal.realtime import robot_cpu
    from rtstack.cli.simulator import serve as run

    arguments = [f"--scene={scene}", f"--seed={seed}", f"--tracker={tracker}", f"--phase-us={phase_us!r}"]
    arguments += [
        f"--drift-ppm={drift_ppm!r}",
        f"--priority={priority}",
        f"--cpu={robot_cpu() if cpu is None else cpu}",
    ]
    arguments += ["--lockstep"] * lockstep + ([f"--faults={faults}"] if faults is not None else [])
    run(arguments, left, right, object_name, displacement_mm)


@app.command()
def check(
    left: Annotated[str | None, typer.Option(help="Address of the left arm.")] = None,
    right: Annotated[str | None, typer.Option(help="Address of the right arm.")] = None,
    cell_file: Annotated[Path | None, typer.Option("--cell", help="TOML description of the cell.")] = None,
    logs: Annotated[Path, typer.Option(help="Where logs are to be written.")] = Path("logs"),
    json: Json = False,
) -> None:
    """Say what this machine lacks, and what that costs; with both addresses hold the arms and judge the link."""
    from rtstack.cli.check import check as run

    run(left, right, cell_file, logs, json)


@app.command("host-setup")
def host_setup(
    user: Annotated[list[str] | None, typer.Option(help="Who may run the stack at a terminal; repeat it.")] = None,
    nic: Annotated[
        list[str] | None, typer.Option(metavar="NAME=ADDR/PREFIX", help="Interface for the arms; repeat it.")
    ] = None,
    isolate: Annotated[
        int | None, typer.Option(help="CPUs for the loop alone; by default one, where there are four.", min=0)
    ] = None,
    kernel: Annotated[str, typer.Option(help="rt (PREEMPT_RT) or generic.")] = "generic",
    units: Annotated[bool, typer.Option("--units", help="Install the systemd units too.")] = False,
    root: Annotated[Path, typer.Option(metavar="DIR", help="Another machine's files.", readable=False)] = Path("/"),
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show every change, and make none.")] = False,
    undo: Annotated[bool, typer.Option("--undo", help="Put back exactly what was there.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Undo also what somebody has changed since.")] = False,
) -> None:
    """Set this PC up for two arms: limits, CPU isolation, governor, network; as root."""
    from rtstack.cli.host_setup import host_setup as run

    run(user or [], nic or [], isolate, kernel, units, root, dry_run, undo, force)


@app.command()
def campaign(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="A plan in deploy/campaigns, such as reference-spreading.")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where references, logs, results and report go.")],
    quick: Annotated[bool, typer.Option("--quick", help="A sample of it, that ends in two minutes.")] = False,
    workers: Annotated[int | None, typer.Option(help="Processes on this machine; one a CPU.", min=1, max=256)] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="Use the workers of this Dask scheduler.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what is missing in DIR.")] = False,
    logs: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Keep references and logs there, not in DIR: s3://BUCKET/PREFIX."),
    ] = None,
) -> None:
    """Run many trials and write what they show: figures, tables, and each claim with a verdict."""
    from rtstack.cli.campaign import campaign as run

    run(name, out, quick, workers, scheduler, resume, logs)


@app.command("tune-monitor")
def tune_monitor(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap...", help="Good runs: trials that succeeded.")],
    out: Annotated[Path, typer.Option(metavar="TOML", help="The parameters to write.")],
    sensitivity: Annotated[
        float,
        typer.Option(help="How many times the worst good run's deviation is unexpected.", min=1.0, max=10.0),
    ] = 1.3,
    json: Json = False,
) -> None:
    """Find the aim-aware monitor's parameters from good runs of one object; a third is held out, and checked."""
    from rtstack.cli.monitor import tune_monitor as run

    run(logs, out, sensitivity, json)


@app.command("impact-map")
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


@app.command()
def plan(
    output: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="The reference to write.")],
    motion: Annotated[Motion, typer.Option(help="Both arms lift the object, or the left one pushes it.")] = Motion.GRAB,
    object_name: ObjectName = "rice_box",
    speed: Annotated[float | None, typer.Option(metavar="M/S", help="Of the pads along y when they hit.")] = None,
    rise: Annotated[float | None, typer.Option(metavar="M/S", help="Of the pads upwards when they hit.")] = None,
    height: Annotated[float | None, typer.Option(metavar="M", help="Of the pads over the object's centre.")] = None,
    posture: Annotated[float | None, typer.Option(metavar="RAD", help="Joint 1 at the impact, from home.")] = None,
    squeeze: Annotated[float | None, typer.Option(metavar="N", help="Force of each pad.")] = None,
    lift: Annotated[float | None, typer.Option(metavar="M", help="How high.")] = None,
    carry: Annotated[float | None, typer.Option(metavar="M", help="How far along x.")] = None,
    travel: Annotated[float | None, typer.Option(metavar="M", help="How far to push.")] = None,
    inertia: Annotated[str | None, typer.Option(help="Of the motors in the map: B_theta, B or none.")] = None,
    post_impact_scale: Annotated[
        float | None, typer.Option(metavar="FACTOR", help="A wrong post-impact velocity on purpose: 0.8 to 1.2.")
    ] = None,
    cell_file: Annotated[Path | None, typer.Option("--cell", help="TOML description of the cell.")] = None,
    json: Json = False,
) -> None:
    """Plan a reference without a demonstration: paths before and after the impact, joined by the impact map."""
    from rtstack.cli.plan import run

    run(
        output, motion, object_name, cell_file, json, speed=speed, rise=rise, height=height, posture=posture,
        squeeze=squeeze, lift=lift, carry=carry, travel=travel, inertia=inertia, post_impact_scale=post_impact_scale,
    )  # fmt: skip


LogFolder = Annotated[Path, typer.Option("--logs", metavar="DIR", help="The folder of logs.")]


@logs_app.command("reviewed")
def logs_reviewed(logs: Annotated[list[Path], typer.Argument(metavar="LOG.mcap...")]) -> None:
    """Mark logs as reviewed: only these ever go."""
    from rtstack.cli.retention import reviewed as run

    run(logs)


@logs_app.command("prune")
def logs_prune(
    folder: LogFolder = Path("logs"),
    older_than: Annotated[float | None, typer.Option(metavar="DAYS", help="These go.", min=0.0)] = None,
    budget: Annotated[
        float | None, typer.Option(metavar="GB", help="Then the oldest go, until all fit.", min=0.0)
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List what would go.")] = False,
) -> None:
    """Remove reviewed logs by age and budget; never one that nobody has reviewed, nor an accepted reference."""
    from rtstack.cli.retention import prune as run

    run(folder, older_than, budget, dry_run)


@logs_app.command("backup")
def logs_backup(
    output: Annotated[Path, typer.Argument(metavar="BACKUP.sqlite", help="A new file, or a folder.")],
    folder: LogFolder = Path("logs"),
) -> None:
    """Write the catalogue and all marks to one file, and read it again."""
    from rtstack.cli.retention import backup as run

    run(folder, output)


@logs_app.command("restore")
def logs_restore(
    source: Annotated[Path, typer.Argument(metavar="BACKUP.sqlite")],
    folder: LogFolder = Path("logs"),
) -> None:
    """Put a backup of the catalogue back; the present one is kept beside it."""
    from rtstack.cli.retention import restore as run

    run(folder, source)


@bench_app.command("tick")
def bench_tick(
    ticks: Annotated[int, typer.Option(help="Ticks of each kind.", min=100)] = 3000,
    solver: Annotated[QpSolver | None, typer.Option(help="QP solver; the default is the stack's.")] = None,
    json: Json = False,
) -> None:
    """The dual-arm tick and its parts, beside the same tick in plain numpy, in one run."""
    from rtstack.cli.bench import tick as run

    run(ticks, solver, json)


@bench_app.command("loop")
def bench_loop(
    cell: Annotated[str, typer.Option(help="direct, lockstep, realtime or fci:LEFT,RIGHT.")] = "realtime",
    seconds: Annotated[float, typer.Option(help="Length of the run.", min=6.0)] = 20.0,
    log: Annotated[Path | None, typer.Option(metavar="OUT.mcap", help="Keep the log here.")] = None,
    json: Json = False,
) -> None:
    """The whole loop: both arms grab and hold a box, controlled, judged and logged."""
    from rtstack.cli.bench import loop as run

    run(cell, seconds, log, json)


@bench_app.command("link")
def bench_link(
    cell: Annotated[str, typer.Option(help="lockstep, realtime or fci:LEFT,RIGHT.")] = "lockstep",
    ticks: Annotated[int, typer.Option(help="Milliseconds of the robot.", min=200)] = 3000,
    json: Json = False,
) -> None:
    """The way from a state to its answer to the next state, over the wire, with both arms."""
    from rtstack.cli.bench import link as run

    run(cell, ticks, json)


@token_app.command("create")
def token_create(
    name: Annotated[str, typer.Option(help="What the program is called, in the audit trail too.")],
    scope: Annotated[str, typer.Option(help="view: look, and press STOP; operate: everything.")] = "view",
    logs: Logs = Path("logs"),
) -> None:
    """Make a token for a program and print it, once."""
    from rtstack.cli.token import create as run

    run(name, scope, logs)


@token_app.command("list")
def token_list(logs: Logs = Path("logs")) -> None:
    """List the tokens, without what makes them tokens."""
    from rtstack.cli.token import list_all as run

    run(logs)


@token_app.command("revoke")
def token_revoke(
    token_id: Annotated[str, typer.Argument(metavar="ID", help="As `rtstack token list` has it.")],
    logs: Logs = Path("logs"),
) -> None:
    """Revoke a token: a running console does not know it any more from now on."""
    from rtstack.cli.token import revoke as run

    run(token_id, logs)


def main() -> None:
    """Run the command line. Bad input is one line on stderr and exit status 2; no traceback reaches a user."""
    arguments = sys.argv[1:] or ["--help"]
    try:
        status = app(arguments, prog_name="rtstack", standalone_mode=False)
    except Exception as error:
        status = _explain(error)
    sys.exit(status if isinstance(status, int) else 0)


def _explain(error: Exception) -> int:
    """Print the one line that an error deserves, and return the exit status."""
    from hal.errors import HardwareError
    from rtstack.configuration import ConfigurationError
    from rtstack.log.errors import LogError
    from rtstack.trials.errors import TrialError

    usage = getattr(error, "format_message", None)  # what typer raises for a wrong option or argument
    if usage is not None:
        return _say(f"{usage()} (see --help)", BAD_INPUT)
    if isinstance(error, TrialError | LogError | ConfigurationError | HardwareError):
        return _say(str(error), BAD_INPUT)
    if os.environ.get("RTSTACK_TRACEBACK"):
        raise error
    return _say(
        f"internal error: {type(error).__name__}: {error}; set RTSTACK_TRACEBACK=1 to see where, and report it", FAILED
    )


def _say(message: str, status: int) -> int:
    print("rtstack: " + " ".join(message.split()), file=sys.stderr)
    return status
