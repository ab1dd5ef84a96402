"""The set-up of a hit and its accuracy."""

from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, NotNegative, Positive
from rtstack.papers.conditions import files_of_plant


@checked(frozen=True, slots=True, config=STRICT)
class Setup:
    """robot: which arm is drawn, the same in all hits. Standard deviations of the platform's inclination and height.

    stiffness, damping, friction: of the contact, N/m, Ns/m, where it is not the scene's own.
    """

    robot: Annotated[int, Field(ge=0)]
    inclination_deg: NotNegative
    height_mm: NotNegative
    stiffness: Positive | None = None
    damping: Positive | None = None
    friction: Positive | None = None


def platform_cell_file() -> Path:
    """Return the path of the cell's description."""
    with as_file(files("deploy.cells") / "platform.toml") as path:
        return path


def platform_files() -> list[Path]:
    """Return the files of the simulated cell."""
    return files_of_plant("scenes/platform.toml", "parameters/plant.toml")
