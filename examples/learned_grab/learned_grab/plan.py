"""The plan of the campaign `learned-grab`, and its cases."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT

METHODS = ("learned", "replay", "reference_spreading")


@checked(frozen=True, slots=True, config=STRICT)
class LearningPlan:
    """A plan's file. demonstrations: within radius_mm of the object's place, turned by up to yaw_deg. radii_mm: of the
    places that are judged, each `repetitions` times in every method; their turn is within yaw_deg too.
    """

    kind: Literal["learned-grab"]
    name: str
    title: str
    seed: int
    demonstrations: Annotated[int, Field(ge=1, le=1000)]
    radius_mm: Annotated[float, Field(ge=0.0, le=120.0)]
    yaw_deg: Annotated[float, Field(ge=0.0, le=30.0)]
    radii_mm: Annotated[tuple[float, ...], Field(min_length=1)]
    repetitions: Annotated[int, Field(ge=1, le=1000)]
    quick: bool = False

    def size(self) -> int:
        """Return the number of trials."""
        return len(METHODS) * len(self.radii_mm) * self.repetitions


@dataclass(frozen=True, slots=True)
class Case:
    """One trial: a method, at one of the places at this distance."""

    method: str
    radius_mm: float
    repetition: int

    @property
    def id(self) -> str:
        """METHOD.RADIUS.REPETITION."""
        return f"{self.method}.{self.radius_mm:g}mm.{self.repetition}"
