"""`rtstack sim`: the simulated robot in this process."""

import os
import signal
from pathlib import Path

import typer

from hal.realtime import ANY_CPU, robot_cpu
from rtstack.model.cell_description import load_cell_description
from rtstack.trials.errors import TrialError


def chosen_cpu(cpu: int | None) -> int:
    """Return where a served robot is to stay, -1 for anywhere. Raises TrialError for a CPU that we have not."""
    ours = os.sched_getaffinity(0)
    if cpu is not None and cpu != ANY_CPU and cpu not in ours:
        raise TrialError(f"--cpu {cpu}: choose one of {', '.join(map(str, sorted(ours)))}, or -1 for any")
    return robot_cpu() if cpu is None else cpu


def serve(
    arguments: list[str], left: str, right: str, object_name: str, displacement: dict[str, float],
    cell_file: Path | None,
) -> None:  # fmt: skip
    """Serve in this process until Ctrl-C. arguments: further ones of `python -m sim_robot.fci`.

    displacement: its options (displacement-mm and the like) with their values.
    """
    signal.signal(signal.SIGINT, lambda number, frame: os._exit(0))  # the imports take seconds, and nothing runs yet
    # nothing is drawn: with glfw MuJoCo looks for its library in a process that would outlive Ctrl-C, with a traceback
    os.environ.setdefault("MUJOCO_GL", "disable")
    from sim_robot.fci.__main__ import main

    if cell_file is not None:
        load_cell_description(cell_file)  # the other keys are the controller's: a mistake in them is one here, too
    cell = f"--cell fci:{left},{right}"
    thing = f" --object {object_name}" * (object_name != "rice_box")
    shift = "".join(f" --{option}={value:g}" for option, value in displacement.items() if value != 0.0)
    file = "" if cell_file is None else f" --cell-file {cell_file}"
    trial = f"run a trial against it: rtstack trial --reference REC.mcap {cell}{thing}{shift}{file}"
    if object_name == "none":
        trial = f"there is nothing to grab: play a log on it: rtstack play LOG.mcap {cell}"
    status = main(
        [f"--left={left}", f"--right={right}", f"--object={object_name}"]
        + [f"--{option}={value!r}" for option, value in displacement.items()]
        + [f"--cell-file={cell_file}"] * (cell_file is not None)
        + arguments,
        prog="rtstack sim",
        next_step=trial,
    )
    if status:
        raise typer.Exit(status)
