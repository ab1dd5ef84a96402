"""What is set up anew for each hit, and how exactly."""

from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.configuration import STRICT, NotNegative


@checked(frozen=True, slots=True, config=STRICT)
class Setup:
    """robot: whose arm it is, in all hits the same. Standard deviations of the platform's inclination and height."""

    robot: Annotated[int, Field(ge=0)]
    inclination_deg: NotNegative
    height_mm: NotNegative


def platform_files() -> list[Path]:
    """Return the files of the simulated cell."""
    paths = []
    for package, name in (("sim_robot.scenes", "platform.toml"), ("sim_robot.parameters", "plant.toml")):
        with as_file(files(package) / name) as path:
            paths.append(path)
    return paths
