"""What is set up anew for each hit, and how exactly."""

from collections.abc import Callable
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.cell import Cell
from rtstack.configuration import STRICT
from rtstack.studies.planar.parameters import NotNegative

Joints = tuple[float, float, float, float, float, float, float]


@checked(frozen=True, slots=True, config=STRICT)
class Setup:
    """robot: whose arm it is, in all hits the same. Standard deviations of the platform's inclination and height."""

    robot: Annotated[int, Field(ge=0)]
    inclination_deg: NotNegative
    height_mm: NotNegative


# setup, home, inclination deg, seed -> cell
OpenCell = Callable[[Setup, Joints, float, int], Cell]
