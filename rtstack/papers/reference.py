"""Which demonstration a trial follows."""

from dataclasses import dataclass


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
