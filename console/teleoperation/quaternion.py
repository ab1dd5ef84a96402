"""Unit quaternions wxyz, (4,), of an orientation or a turn in the world."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def product(a: Array, b: Array) -> Array:
    """Return the quaternion a b."""
    w, v, x, u = float(a[0]), a[1:], float(b[0]), b[1:]
    return np.asarray([w * x - float(v @ u), *(w * u + x * v + np.cross(v, u))], np.float64)


def conjugate(q: Array) -> Array:
    """Return the inverse of a unit quaternion."""
    return np.concatenate([q[:1], -q[1:]])


def rotated(q: Array, v: Array) -> Array:
    """Return the vector v (3,) turned by q."""
    return np.asarray(v + 2.0 * np.cross(q[1:], np.cross(q[1:], v) + q[0] * v), np.float64)


def quaternion(turn: Array) -> Array:
    """Return the quaternion of a rotation vector (3,), rad."""
    angle = float(np.linalg.norm(turn))
    half = 0.5 * angle
    return np.concatenate([np.array([np.cos(half)]), 0.5 * float(np.sinc(half / np.pi)) * turn])


def angle_between(a: Array, b: Array) -> float:
    """Return the angle between two orientations, rad."""
    return float(2.0 * np.arccos(np.clip(abs(a @ b), 0.0, 1.0)))
