"""What is fixed to an arm's flange: a pad, with its whole transform, mass, centre and inertia."""

import math
from typing import Annotated

import numpy as np
from pydantic import AfterValidator
from pydantic.dataclasses import dataclass as checked

from hal.base.arrays import Array
from hal.base.configuration import STRICT, NotNegative, Real

Vector = tuple[Real, Real, Real]
Moments = tuple[Real, Real, Real, Real, Real, Real]
_UNIT_TOLERANCE = 1e-2  # four rounded digits
_ROUNDED = 1e-6  # of the largest moment: a thin plate's a + b is c


def _unit(q: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    if abs(math.hypot(*q) - 1.0) > _UNIT_TOLERANCE:
        raise ValueError(f"a unit quaternion wxyz is expected, not one of norm {math.hypot(*q):.3g}")
    return q


def of_a_body(moments: Moments) -> Moments:
    """Return the moments (xx, yy, zz, xy, xz, yz), kg m^2. Raises ValueError unless the principal ones, a <= b <= c,
    are above 0 and a + b >= c, as every body's are."""
    xx, yy, zz, xy, xz, yz = moments
    a, b, c = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).tolist()
    if not (a > 0.0 and a + b >= c * (1.0 - _ROUNDED)):
        raise ValueError(
            f"no body has the principal moments {a:.3g}, {b:.3g}, {c:.3g} kg m^2: each is above 0, and none is "
            "larger than the sum of the two others"
        )
    return moments


Quaternion = Annotated[tuple[Real, Real, Real, Real], AfterValidator(_unit)]


@checked(frozen=True, slots=True, config=STRICT)
class Pad:
    """A box on the flange whose outer face is the end effector, and what holds it.

    size: along the face's x and y, and its thickness, m. The face's frame in the flange's: its middle is at (offset_xy,
    flange_to_face), m, its z looks out of the pad; orientation_wxyz. Of everything on the flange: mass kg, centre of
    mass m, and inertia about it, (xx, yy, zz, xy, xz, yz) kg m^2, along the flange's axes; None: the box's own.
    """

    size: Vector
    mass: NotNegative
    flange_to_face: Real
    offset_xy: tuple[Real, Real] = (0.0, 0.0)
    orientation_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)
    centre: Vector | None = None
    inertia: Annotated[Moments, AfterValidator(of_a_body)] | None = None

    @property
    def F_T_face(self) -> Array:
        """The face's frame in the flange's, (4, 4), row-major, m."""
        w, x, y, z = np.array(self.orientation_wxyz) / math.hypot(*self.orientation_wxyz)
        T = np.eye(4)
        T[:3, :3] = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
        T[:3, 3] = (*self.offset_xy, self.flange_to_face)
        return T

    @property
    def F_T_box(self) -> Array:
        """The frame of the box's middle in the flange's, (4, 4), row-major, m."""
        T = self.F_T_face
        T[:3, 3] -= T[:3, 2] * (self.size[2] / 2.0)
        return T

    @property
    def F_x_centre(self) -> Array:
        """The centre of mass in the flange's frame, (3,) m."""
        return self.F_T_box[:3, 3] if self.centre is None else np.array(self.centre)

    @property
    def I_centre(self) -> Array:
        """The inertia about the centre of mass along the flange's axes, (3, 3) kg m^2."""
        if self.inertia is not None:
            xx, yy, zz, xy, xz, yz = self.inertia
            return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        squares, R = np.array(self.size) ** 2, self.F_T_face[:3, :3]
        return R @ np.diag(self.mass / 12.0 * (squares.sum() - squares)) @ R.T


DEFAULT_PAD = Pad(size=(0.1, 0.1, 0.03), mass=0.35, flange_to_face=0.03)
