"""A way in joint space for both arms together: straight, from rest to rest, and they arrive at the same time."""

from dataclasses import dataclass

import numpy as np

from hal.base.arrays import Array

# of s(x) = 10 x^3 - 15 x^4 + 6 x^5 over x = 0..1: the largest slope (at 1/2) and curvature (at 1/2 -+ sqrt(3)/6)
_STEEPEST, _MOST_CURVED = 15.0 / 8.0, 10.0 / np.sqrt(3.0)


@dataclass(frozen=True, slots=True)
class JointSpeed:
    """How fast any joint may turn: rad/s and rad/s^2."""

    speed: float
    acceleration: float


@dataclass(frozen=True, slots=True)
class JointPath:
    """start and goal (2, 7) rad, left and right arm; duration s."""

    start: Array
    goal: Array
    duration_s: float

    @classmethod
    def between(cls, start: Array, goal: Array, limit: JointSpeed) -> "JointPath":
        """Return the quickest way between two postures (2, 7) on which no joint exceeds the limit."""
        furthest = float(np.abs(goal - start).max())
        duration_s = max(_STEEPEST * furthest / limit.speed, np.sqrt(_MOST_CURVED * furthest / limit.acceleration))
        return cls(np.array(start), np.array(goal), float(duration_s))

    def at(self, t_s: float) -> Array:
        """Return the posture (2, 7), rad, at a time since the start: a quintic, held before and after."""
        x = min(max(t_s / self.duration_s, 0.0), 1.0) if self.duration_s > 0.0 else 1.0
        return self.start + (10.0 - 15.0 * x + 6.0 * x * x) * x**3 * (self.goal - self.start)
