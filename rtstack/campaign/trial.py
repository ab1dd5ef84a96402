"""A trial of a campaign as data: what is to be run, with an id that stays the same for ever."""

import hashlib
from dataclasses import dataclass

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
    """One trial. reference: its name; displacement along the world's y; seed: of plant, noise and placement."""

    experiment: str
    conditions: str
    reference: str
    object: str
    displacement_mm: float
    repetition: int
    controller: Controller
    seed: int

    @property
    def id(self) -> str:
        """A name that is a file's name too, and says everything but the seed, which follows from it."""
        place = f"{self.reference.replace('/', '-')}.{self.displacement_mm:+g}mm.{self.repetition}"
        return f"{self.experiment}.{self.conditions}.{place}.{self.controller}"


def seed_of(campaign: int, *what: object) -> int:
    """Return a seed (32 bits) that depends on the campaign's seed and on what it is for, and on nothing else."""
    text = repr((campaign, *map(str, what)))
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=4).digest(), "little")
