"""A trial of a campaign as data: what is to be run, with an id that stays the same for ever."""

import hashlib
from dataclasses import dataclass

from hal.displacement import Displacement
from rtstack.trials.specification import Controller


@dataclass(frozen=True, slots=True)
class Reference:
    """A demonstration: this variation of the scripted operator, with this object.

    speed_m_s: of the pads at the surface, if not the variation's own.
    """

    object: str
    variation: int
    speed_m_s: float | None = None

    @classmethod
    def named(cls, name: str) -> "Reference":
        """Return the reference of a name such as rice_box/3, or rice_box/3@0.5 for another speed in m/s."""
        thing, _, number = name.partition("/")
        variation, _, speed = number.partition("@")
        return cls(thing, int(variation), float(speed) if speed else None)

    @property
    def name(self) -> str:
        """OBJECT/VARIATION, or OBJECT/VARIATION@SPEED."""
        speed = "" if self.speed_m_s is None else f"@{self.speed_m_s:g}"
        return f"{self.object}/{self.variation}{speed}"

    @property
    def file(self) -> str:
        """Name of its recording."""
        return f"{self.name.replace('/', '-')}.mcap"


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
    controller: Controller
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


def seed_of(campaign: int, *what: object) -> int:
    """Return a seed (32 bits) that depends on the campaign's seed and on what it is for, and on nothing else."""
    text = repr((campaign, *map(str, what)))
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=4).digest(), "little")


def seeded(y_mm: float, x_mm: float, yaw_deg: float) -> tuple[float, ...]:
    """Return what of a place a seed depends on: along y alone where there is no more, as it was before there was."""
    return (y_mm,) if x_mm == yaw_deg == 0.0 else (y_mm, x_mm, yaw_deg)
