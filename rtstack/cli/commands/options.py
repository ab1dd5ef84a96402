"""Options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

from rtstack.trials.controllers import controller_names, known_controller

FAILED = 1  # exit status


def _controller(name: str) -> str:
    try:
        return known_controller(name)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout, and nothing else.")]
ObjectName = Annotated[str, typer.Option("--object", help="An object of the cell.")]
ControllerChoice = Annotated[
    str,
    typer.Option(
        metavar=f"[{'|'.join(controller_names())}]",
        callback=_controller,
        help="The proposed controller, a baseline, contact_completion, or one of another package.",
    ),
]
CellKind = Annotated[
    str, typer.Option(help="direct, lockstep, realtime, fci:LEFT,RIGHT, or NAME[:ARGUMENT] of another package.")
]
Profile = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="How honest the simulated robot is: ideal (the default), honest or harsh."),
]
ShiftY = Annotated[float, typer.Option("--displacement-mm", help="Shift of the object along y.")]
ShiftX = Annotated[float, typer.Option("--displacement-x-mm", help="Shift of the object along x.")]
Yaw = Annotated[float, typer.Option("--yaw-deg", help="Turn of the object about z.")]
LeftArm = Annotated[str | None, typer.Option(help="Address of the left arm.")]
RightArm = Annotated[str | None, typer.Option(help="Address of the right arm.")]
CellFile = Annotated[Path | None, typer.Option("--cell-file", help="TOML description of the cell and its objects.")]
# the first name of --cell-file where the cell is no kind: other people's scripts and unit files have it
OldCellFile = Annotated[Path | None, typer.Option("--cell", hidden=True)]
Seed = Annotated[int, typer.Option(help="Seed of noise, plant and placement.", min=0)]
LogFolder = Annotated[Path, typer.Option("--logs", metavar="DIR", help="The folder of logs.")]
LogsWritten = Annotated[Path, typer.Option("--logs", metavar="DIR", help="Where logs are written.")]
LogOut = Annotated[Path | None, typer.Option("--log", metavar="OUT.mcap", help="The log to write.")]
Faults = Annotated[Path | None, typer.Option("--faults", metavar="FILE", help="TOML script of what goes wrong.")]
