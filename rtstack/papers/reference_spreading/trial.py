"""A trial of a campaign as data: what is to be run, with an id that stays the same for ever."""

from dataclasses import dataclass

from hal.displacement import Displacement


@dataclass(frozen=True, slots=True)
class Trial:
    """One trial. reference: its name; displacement along the world's y and x, and about z; seed: of plant, noise and
    placement.
    """

    experiment: str
    conditions: str
    reference: str
    object: str
    displacement_mm: float
    repetition: int
    controller: str
    seed: int
    displacement_x_mm: float = 0.0
    yaw_deg: float = 0.0

    @property
    def displacement(self) -> Displacement:
        """Where the object is put."""
        return Displacement.given(self.displacement_mm, self.displacement_x_mm, self.yaw_deg)

    @property
    def id(self) -> str:
        """A name that is a file's name too, and says everything but the seed, which follows from it."""
        x, yaw = self.displacement_x_mm, self.yaw_deg
        shift = f"{self.displacement_mm:+g}mm" + f"{x:+g}mmx" * (x != 0.0) + f"{yaw:+g}deg" * (yaw != 0.0)
        place = f"{self.reference.replace('/', '-')}.{shift}.{self.repetition}"
        return f"{self.experiment}.{self.conditions}.{place}.{self.controller}"


def seeded(y_mm: float, x_mm: float, yaw_deg: float) -> tuple[float, ...]:
    """Return what of a place a seed depends on: along y alone where there is no more, as it was before there was."""
    return (y_mm,) if x_mm == yaw_deg == 0.0 else (y_mm, x_mm, yaw_deg)
