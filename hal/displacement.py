"""How far an object stands from its place."""

from dataclasses import dataclass
from math import degrees, radians
from typing import Self


@dataclass(frozen=True, slots=True)
class Displacement:
    """Along the world's x and y, m, and turned about its z, rad, from the object's place."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0

    @classmethod
    def of(cls, displacement: "Displacement | float") -> "Displacement":
        """Return the displacement; a number is one along y alone, m."""
        return displacement if isinstance(displacement, Displacement) else cls(y_m=displacement)

    @classmethod
    def given(cls, y_mm: float, x_mm: float = 0.0, yaw_deg: float = 0.0) -> Self:
        """Return what a person gives in mm and degrees."""
        return cls(1e-3 * x_mm, 1e-3 * y_mm, radians(yaw_deg))

    @property
    def yaw_deg(self) -> float:
        return degrees(self.yaw_rad)

    @property
    def in_words(self) -> str:
        x, yaw = 1e3 * self.x_m, self.yaw_deg
        return f"{1e3 * self.y_m:+g} mm" + f", x {x:+g} mm" * (x != 0.0) + f", yaw {yaw:+.4g} deg" * (yaw != 0.0)
