"""`rtstack sim`: the simulated robot in this process."""

import os
import signal
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from hal.base.realtime import ANY_CPU, robot_cpu
from hal.base.shared import remove_left
from rtstack.cli.options import CellFile, Faults, Profile, Seed, ShiftX, ShiftY, Yaw
from rtstack.trials.errors import TrialError
from sim_robot.desk.box import SELF_TEST_EVERY_S

commands = typer.Typer()


@commands.command()
def sim(
    scene: Annotated[
        str,
        typer.Option(metavar="NAME", help="The scene to simulate: grab, hand (a Franka Hand), platform, or a TOML."),
    ] = "grab",
    left: Annotated[str, typer.Option(metavar="ADDR", help="Address of the left arm.")] = "127.0.0.11",
    right: Annotated[str, typer.Option(metavar="ADDR", help="Address of the right arm.")] = "127.0.0.12",
    only: Annotated[
        Literal["left", "right"] | None,
        typer.Option(help="Serve this arm alone; so does a cell's file that has one arm."),
    ] = None,
    lockstep: Annotated[bool, typer.Option("--lockstep", help="Wait for every moving arm's answer.")] = False,
    seed: Seed = 0,
    object_name: Annotated[
        str,
        typer.Option(
            "--object",
            help="An object of the cell, or none: an empty cell, as a playback needs it. By default the scene's first.",
        ),
    ] = "",
    displacement_mm: ShiftY = 0.0,
    displacement_x_mm: ShiftX = 0.0,
    yaw_deg: Yaw = 0.0,
    cell_file: CellFile = None,
    faults: Faults = None,
    profile: Profile = "ideal",
    tracker: Annotated[
        str, typer.Option(metavar="HOST:PORT", help="Where the object's poses are sent (UDP); empty for nowhere.")
    ] = "127.0.0.1:1341",
    phase_us: Annotated[float, typer.Option(help="How much later the right arm's clock ticks.")] = 0.0,
    drift_ppm: Annotated[float, typer.Option(help="How much faster the right arm's clock runs.")] = 0.0,
    desk: Annotated[bool, typer.Option("--desk", help="Serve Desk too; the arms begin locked, with FCI off.")] = False,
    priority: Annotated[int, typer.Option(help="SCHED_FIFO priority, 0 for none.", min=0, max=99)] = 80,
    cpu: Annotated[
        int | None,
        typer.Option(help="CPU to stay on, -1 for any; by default the first, the loop takes the last.", min=-1),
    ] = None,
    parameters: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The plant's parameters: TOML as parameters/plant.toml.")
    ] = None,
    arms_seed: Annotated[
        int | None, typer.Option(help="Seed of the arms' own parameters, by default --seed.", min=0)
    ] = None,
    slower: Annotated[
        float, typer.Option(help="How many times slower than real time the robot runs.", min=1.0, max=100.0)
    ] = 1.0,
    self_test_due_s: Annotated[
        float, typer.Option(help="With --desk: time until the first self-test is due.")
    ] = SELF_TEST_EVERY_S,
) -> None:
    """Serve the simulated arms at their addresses, as robots would be, until Ctrl-C."""
    options: dict[str, Any] = {**locals(), "cpu": robot_cpu() if cpu is None else cpu}
    ours = os.sched_getaffinity(0)
    if cpu is not None and cpu != ANY_CPU and cpu not in ours:
        raise TrialError(f"--cpu {cpu}: choose one of {', '.join(map(str, sorted(ours)))}, or -1 for any")
    # the imports take seconds, and nothing runs yet
    signal.signal(signal.SIGINT, lambda number, frame: os._exit(0))
    # nothing is drawn: with glfw MuJoCo looks for its library in a process that would outlive Ctrl-C, with a traceback
    os.environ.setdefault("MUJOCO_GL", "disable")
    from sim_robot.fci.program import Options, serve

    if cell_file is not None:
        from rtstack.model.cell_description import load_cell_description

        load_cell_description(cell_file)  # the other keys are the controller's: a mistake in them is one here, too

    def next_step(addresses: dict[str, str]) -> str:
        cell = f"--cell fci:{addresses.get('left', '')}" + (f",{addresses['right']}" if "right" in addresses else "")
        file = "" if cell_file is None else f" --cell-file {cell_file}"
        if len(addresses) == 1:
            file = file or " --cell-file CELL.toml"  # ours has two arms
            return f"one arm alone grabs nothing: play a log on it: rtstack play LOG.mcap {cell}{file}"
        if object_name == "none":
            return f"there is nothing to grab: play a log on it: rtstack play LOG.mcap {cell}"
        thing = f" --object {object_name}" * (object_name not in ("", "rice_box"))
        shifts = {"displacement-mm": displacement_mm, "displacement-x-mm": displacement_x_mm, "yaw-deg": yaw_deg}
        shift = "".join(f" --{option}={value:g}" for option, value in shifts.items() if value != 0.0)
        return f"run a trial against it: rtstack trial --reference REC.mcap {cell}{thing}{shift}{file}"

    remove_left()
    if status := serve(Options(**options), next_step):
        raise typer.Exit(status)
