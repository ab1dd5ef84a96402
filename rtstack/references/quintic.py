"""Quintic paths through via points: position, velocity and acceleration are continuous."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from hal.base.arrays import Array


@dataclass(frozen=True, slots=True)
class ViaPoint:
    """A coordinate at a time: s, m, m/s, m/s^2."""

    t_s: float
    position: float
    velocity: float = 0.0
    acceleration: float = 0.0


def quintic_path(points: list[ViaPoint], t_s: Array) -> tuple[Array, Array]:
    """Return position and velocity (n,) at the times t_s (n,): see quintic_motion."""
    position, velocity, _ = quintic_motion(points, t_s)
    return position, velocity


def quintic_motion(points: list[ViaPoint], t_s: Array) -> tuple[Array, Array, Array]:
    """Return position, velocity and acceleration (n,) at the times t_s (n,), at rest before the first point and after
    the last: (11)-(13) of the impact-map paper.

    Raises ValueError where the times of the points do not increase.
    """
    position = np.full_like(t_s, points[0].position)
    velocity = np.zeros_like(t_s)
    acceleration = np.zeros_like(t_s)
    for a, b in pairwise(points):
        duration = b.t_s - a.t_s
        if not duration > 0.0:
            raise ValueError(f"via points at {a.t_s} s and {b.t_s} s: the times have to increase")
        inside = (t_s >= a.t_s) & (t_s < b.t_s)
        x = (t_s[inside] - a.t_s) / duration
        distance = b.position - a.position
        v0, v1 = a.velocity * duration, b.velocity * duration
        a0, a1 = a.acceleration * duration**2, b.acceleration * duration**2
        c2 = a0 / 2.0
        c3 = 10.0 * distance - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1
        c4 = -15.0 * distance + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1
        c5 = 6.0 * distance - 3.0 * v0 - 3.0 * v1 - 0.5 * a0 + 0.5 * a1
        position[inside] = a.position + v0 * x + c2 * x**2 + c3 * x**3 + c4 * x**4 + c5 * x**5
        velocity[inside] = (v0 + 2 * c2 * x + 3 * c3 * x**2 + 4 * c4 * x**3 + 5 * c5 * x**4) / duration
        acceleration[inside] = (2 * c2 + 6 * c3 * x + 12 * c4 * x**2 + 20 * c5 * x**3) / duration**2
    position[t_s >= points[-1].t_s] = points[-1].position
    return position, velocity, acceleration
