"""Unit quaternions wxyz, (4,), of an orientation or a turn in the world."""

from itertools import permutations
from itertools import product as product_of

import numpy as np

from hal.base.arrays import Array
from rtstack.model.rotation import quaternion_from_rotation


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


def rotation_vector(q: Array) -> Array:
    """Return the rotation vector (3,), rad, of the shorter turn that a unit quaternion is."""
    q = q if q[0] >= 0.0 else -q
    sine = float(np.linalg.norm(q[1:]))
    return np.zeros(3) if sine == 0.0 else 2.0 * float(np.arctan2(sine, q[0])) / sine * q[1:]


def angle_between(a: Array, b: Array) -> float:
    """Return the angle between two orientations, rad."""
    return float(2.0 * np.arccos(np.clip(abs(a @ b), 0.0, 1.0)))


def squared(q: Array) -> Array:
    """Return the orientation nearest to q whose axes are along the world's, of the 24 that there are."""
    columns = np.array([rotated(q, axis) for axis in np.eye(3)]).T
    best, most = q, -np.inf
    for order in permutations(range(3)):
        for signs in product_of((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[list(order), range(3)] = signs
            likeness = float((turn * columns).sum())
            if np.linalg.det(turn) > 0.0 and likeness > most:
                best, most = np.zeros(4), likeness
                quaternion_from_rotation(turn, best)
    return best if best @ q >= 0.0 else -best
