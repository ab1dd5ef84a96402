"""The planar plant and its controller as their file has them (deploy/studies), and as compiled code takes them."""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT, NotNegative, Positive, Real

Three = tuple[Positive, Positive, Positive]

# m, kg; a kg m^2, b kg m^2 and G kg m of `PlanarArm.record`; B, B_theta kg m^2; K Nm/rad; D Nms/rad; gravity m/s^2
ARM = np.dtype([
    ("length", "f8", 3), ("half_width", "f8"), ("a", "f8", 3), ("b", "f8", (3, 3)), ("G", "f8", 3),
    ("B", "f8", 3), ("B_theta", "f8", 3), ("K", "f8", 3), ("D", "f8", 3), ("gravity", "f8"),
])  # fmt: skip
# a frictionless plane through point, of this normal; force per corner stiffness d^exponent exp(damping d-dot), N
SURFACE = np.dtype(
    [("point", "f8", 2), ("normal", "f8", 2), ("stiffness", "f8"), ("exponent", "f8"), ("damping", "f8")]
)


@checked(frozen=True, slots=True, config=STRICT)
class PlanarArm:
    """Three uniform links in a vertical plane; the last one ends in a flat plate of twice half_width_m, across it."""

    length_m: Three
    mass_kg: Three
    half_width_m: NotNegative
    B_kg_m2: Three
    B_theta_kg_m2: Three
    K_nm_rad: Three
    D_nms_rad: tuple[NotNegative, NotNegative, NotNegative]
    gravity_m_s2: NotNegative

    def record(self) -> NDArray[np.void]:
        """Return (1,) of ARM, with the coefficients of the energies in the links' absolute angles psi:

        T = sum a_i psi-dot_i^2 / 2 + sum_{i<j} b_ij cos(psi_i - psi_j) psi-dot_i psi-dot_j, V = g sum G_i sin psi_i.
        """
        record = np.zeros(1, ARM)
        length, mass = np.array(self.length_m), np.array(self.mass_kg)
        beyond = np.array([mass[i + 1 :].sum() for i in range(3)])  # what each link carries
        inertia = mass * length**2 / 12.0
        inertia[2] += mass[2] * (2.0 * self.half_width_m) ** 2 / 12.0
        first = mass * length / 2.0 + beyond * length
        record["a"] = inertia + mass * (length / 2.0) ** 2 + beyond * length**2
        for i in range(3):
            for j in range(i + 1, 3):
                record["b"][0, i, j] = record["b"][0, j, i] = length[i] * first[j]
        record["length"], record["half_width"], record["G"] = length, self.half_width_m, first
        record["B"], record["B_theta"] = self.B_kg_m2, self.B_theta_kg_m2
        record["K"], record["D"], record["gravity"] = self.K_nm_rad, self.D_nms_rad, self.gravity_m_s2
        return record


@checked(frozen=True, slots=True, config=STRICT)
class Contact:
    """Exponentially extended Hunt-Crossley law of a corner of the plate: F = stiffness d^exponent e^(damping d-dot)."""

    stiffness: Positive
    exponent: Positive
    damping_s_m: NotNegative

    def surface(self, x_m: float, y_m: float, inclination_rad: float) -> NDArray[np.void]:
        """Return (1,) of SURFACE: a plane through (x, y), inclined against the horizontal."""
        record = np.zeros(1, SURFACE)
        record["point"] = x_m, y_m
        record["normal"] = -np.sin(inclination_rad), np.cos(inclination_rad)
        record["stiffness"], record["exponent"] = self.stiffness, self.exponent
        record["damping"] = self.damping_s_m
        return record


@checked(frozen=True, slots=True, config=STRICT)
class Task:
    """Hit the surface at speed_m_s after approach_s, then slide to rest within settle_s, pressing with push_n."""

    speed_m_s: Positive
    approach_s: Positive
    settle_s: Positive
    duration_s: Positive
    surface_height_m: Real
    push_n: Positive


@checked(frozen=True, slots=True, config=STRICT)
class Gains:
    """Of the tracking law: N/m, N/m, Nm/rad, and the ratio to critical damping; K_O of (6), 1/s."""

    stiffness: Three
    damping_ratio: Positive
    observer_gain_hz: Positive
    period_s: Positive
    substeps: Annotated[int, Field(ge=1, le=200)]  # of the plant in a period
