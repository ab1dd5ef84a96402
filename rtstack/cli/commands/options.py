"""Options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout, and nothing else.")]
ObjectName = Annotated[str, typer.Option("--object", help="An object of the cell.")]
CellKind = Annotated[str, typer.Option(help="direct, lockstep, realtime or fci:LEFT,RIGHT.")]
Displacement = Annotated[float, typer.Option(help="Shift of the object along y.")]
LeftArm = Annotated[str | None, typer.Option(help="Address of the left arm.")]
RightArm = Annotated[str | None, typer.Option(help="Address of the right arm.")]
StackCell = Annotated[Path | None, typer.Option("--cell", help="TOML description of the cell.")]
Seed = Annotated[int, typer.Option(help="Seed of noise, plant and placement.", min=0)]
