"""Commands that start the stack, its parts and the simulated arms, and clear what arms have latched."""

from pathlib import Path
from typing import Annotated

import typer

from rtstack.cli.commands.options import (
    CellFile,
    Faults,
    Json,
    LeftArm,
    LogOut,
    LogsWritten,
    ObjectName,
    OldCellFile,
    Profile,
    RightArm,
    Seed,
    ShiftX,
    ShiftY,
    Yaw,
)

commands = typer.Typer()
Port = Annotated[int, typer.Option(help="Port of the console, on the loopback address.", min=0, max=65535)]
LiveCellKind = Annotated[
    str | None,
    typer.Option(metavar="NAME[:ARGUMENT]", help="Kind of cell instead of --left and --right, also of a package's."),
]
RunFolder = Annotated[Path, typer.Option("--run", metavar="DIR", help="Where robot process and console meet.")]


@commands.command("recover-arms")
def recover_arms(
    cell: Annotated[str | None, typer.Option(help="fci:LEFT,RIGHT; by default the arms of the running stack.")] = None,
    stack: Annotated[
        Path | None, typer.Option(metavar="SOCKET", help="Which stack, where several are running.")
    ] = None,
) -> None:
    """Clear what the arms have latched (a fault, a reflex), once its cause is gone."""
    from rtstack.cli.recovery import recover_arms as run

    run(cell, stack)


@commands.command()
def up(
    port: Port = 8080,
    logs: LogsWritten = Path("logs"),
    cell_file: CellFile = None,
    left: LeftArm = None,
    right: RightArm = None,
    cell_kind: LiveCellKind = None,
    cell: OldCellFile = None,
    profile: Profile = None,
    https: Annotated[bool, typer.Option("--https", help="Speak HTTPS, with an authority of your own.")] = False,
    host: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Listen there instead of on the loopback address; needs --https."),
    ] = None,
) -> None:
    """Start the whole stack, with the arms at --left and --right or the simulated cell; Ctrl-C ends all of it."""
    from rtstack.cli.stack import chosen_kind
    from rtstack.cli.stack import up as run

    run(port, logs, cell_file or cell, chosen_kind(cell_kind, left, right, profile), host, https)


@commands.command()
def robot(
    run_folder: RunFolder = Path("/run/rtstack"),
    logs: LogsWritten = Path("logs"),
    cell_file: CellFile = None,
    left: LeftArm = None,
    right: RightArm = None,
    cell_kind: LiveCellKind = None,
    cell: OldCellFile = None,
    profile: Profile = None,
) -> None:
    """Run the robot process alone, as a service does: cell, loop and logs; disarmed, until an operator arms."""
    from rtstack.cli.stack import chosen_kind
    from rtstack.cli.stack import robot as run

    run(run_folder, logs, cell_file or cell, chosen_kind(cell_kind, left, right, profile))


@commands.command()
def console(
    run_folder: RunFolder = Path("/run/rtstack"),
    port: Port = 8080,
    logs: LogsWritten = Path("logs"),
    cell_file: CellFile = None,
    left: LeftArm = None,
    right: RightArm = None,
    cell_kind: LiveCellKind = None,
    cell: OldCellFile = None,
    profile: Profile = None,
) -> None:
    """Run the console alone, beside `rtstack robot`, with the same options."""
    from rtstack.cli.stack import chosen_kind
    from rtstack.cli.stack import console as run

    run(run_folder, port, logs, cell_file or cell, chosen_kind(cell_kind, left, right, profile))


@commands.command()
def teleoperate(
    device: Annotated[
        str, typer.Argument(metavar="NAME[:ARGUMENT]", help="An input device that an installed package offers.")
    ],
    token: Annotated[str, typer.Option(envvar="RTSTACK_TOKEN", help="Made by `rtstack token create --scope operate`.")],
    console: Annotated[str, typer.Option(metavar="URL", help="Of the console.")] = "http://127.0.0.1:8080",
    object_name: ObjectName = "rice_box",
    record: Annotated[bool, typer.Option("--record", help="As a recording, from home; else practise.")] = False,
) -> None:
    """Take control, arm, and let an input device lead the arms of a running stack; Ctrl-C ends it softly."""
    from rtstack.cli.teleoperate import teleoperate as run

    run(device, console, token, object_name, record)


@commands.command()
def policy(
    name: Annotated[str, typer.Argument(metavar="NAME[:ARGUMENT]", help="A policy that an installed package offers.")],
    console: Annotated[
        str | None, typer.Option(metavar="URL", help="Of a running stack; else a simulated cell in this process.")
    ] = None,
    token: Annotated[
        str, typer.Option(envvar="RTSTACK_TOKEN", help="Made by `rtstack token create --scope operate`.")
    ] = "",
    rate_hz: Annotated[float, typer.Option(help="Observations a second, 10 to 50.")] = 20.0,
    object_name: ObjectName = "rice_box",
    displacement_mm: ShiftY = 0.0,
    displacement_x_mm: ShiftX = 0.0,
    yaw_deg: Yaw = 0.0,
    seed: Seed = 0,
    log: LogOut = None,
    cell_file: CellFile = None,
    json: Json = False,
) -> None:
    """Let a policy lead the arms, as an operator would: at a console once an operator gives it a lease there."""
    from hal.displacement import Displacement
    from rtstack.cli.policy import run_at_console, run_in_process

    if console is not None:
        run_at_console(name, rate_hz, console, token)
        return
    place = Displacement.given(displacement_mm, displacement_x_mm, yaw_deg)
    run_in_process(name, rate_hz, object_name, place, seed, log, json, cell_file)


@commands.command()
def sim(
    scene: Annotated[
        str, typer.Option(metavar="NAME", help="The scene to simulate: grab, or hand with a Franka Hand.")
    ] = "grab",
    left: Annotated[str, typer.Option(metavar="ADDR", help="Address of the left arm.")] = "127.0.0.11",
    right: Annotated[str, typer.Option(metavar="ADDR", help="Address of the right arm.")] = "127.0.0.12",
    lockstep: Annotated[bool, typer.Option("--lockstep", help="Wait for every moving arm's answer.")] = False,
    seed: Seed = 0,
    object_name: Annotated[
        str, typer.Option("--object", help="An object of the cell, or none: an empty cell, as a playback needs it.")
    ] = "rice_box",
    displacement_mm: ShiftY = 0.0,
    displacement_x_mm: ShiftX = 0.0,
    yaw_deg: Yaw = 0.0,
    cell_file: CellFile = None,
    faults: Faults = None,
    profile: Profile = None,
    tracker: Annotated[
        str, typer.Option(metavar="HOST:PORT", help="Who is sent the object's poses (UDP).")
    ] = "127.0.0.1:1341",
    phase_us: Annotated[float, typer.Option(help="How much later the right arm's clock ticks.")] = 0.0,
    drift_ppm: Annotated[float, typer.Option(help="How much faster the right arm's clock runs.")] = 0.0,
    desk: Annotated[bool, typer.Option("--desk", help="Serve Desk too; the arms begin locked, with FCI off.")] = False,
    priority: Annotated[int, typer.Option(help="SCHED_FIFO priority, 0 for none.", min=0, max=99)] = 80,
    cpu: Annotated[
        int | None,
        typer.Option(help="CPU to stay on, -1 for any; by default the first, the loop takes the last.", min=-1),
    ] = None,
) -> None:
    """Serve the simulated arms at their addresses, as robots would be, until Ctrl-C."""
    from rtstack.cli.simulator import chosen_cpu
    from rtstack.cli.simulator import serve as run

    arguments = [f"--scene={scene}", f"--seed={seed}", f"--tracker={tracker}", f"--phase-us={phase_us!r}"]
    arguments += [
        f"--drift-ppm={drift_ppm!r}",
        f"--priority={priority}",
        f"--cpu={chosen_cpu(cpu)}",
    ]
    arguments += [f"--profile={profile}"] * (profile is not None)
    arguments += ["--lockstep"] * lockstep + ["--desk"] * desk + ([f"--faults={faults}"] if faults is not None else [])
    shifts = {"displacement-mm": displacement_mm, "displacement-x-mm": displacement_x_mm, "yaw-deg": yaw_deg}
    run(arguments, left, right, object_name, shifts, cell_file)
