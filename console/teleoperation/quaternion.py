"""Unit quaternions wxyz, (4,), of an orientation or a turn in the world: what trimesh and SciPy have, and more."""

import numpy as np
from scipy.spatial.transform import Rotation
from trimesh.transformations import quaternion_conjugate as conjugate
from trimesh.transformations import quaternion_multiply as product

from hal.base.arrays import Array

__all__ = ["angle_between", "conjugate", "product", "quaternion", "rotation_vector", "squared"]

_SQUARE = Rotation.create_group("O")  # all turns after which axes are along axes


def quaternion(turn: Array) -> Array:
    """Return the quaternion of a rotation vector (3,), rad."""
    return Rotation.from_rotvec(turn).as_quat(scalar_first=True)


def rotation_vector(q: Array) -> Array:
    """Return the rotation vector (3,), rad, of the shorter turn that a unit quaternion is."""
    return Rotation.from_quat(q, scalar_first=True).as_rotvec()


def angle_between(a: Array, b: Array) -> float:
    """Return the angle between two orientations, rad."""
    return float(2.0 * np.arccos(np.clip(abs(a @ b), 0.0, 1.0)))


def squared(q: Array) -> Array:
    """Return the orientation nearest to q whose axes are along the world's, of the 24 that there are."""
    known = _SQUARE.as_quat(scalar_first=True)
    likeness = known @ q
    best = int(np.abs(likeness).argmax())
    return known[best] if likeness[best] >= 0.0 else -known[best]
