"""Poses of both hands, (2, 7) of (left, right): position m, quaternion wxyz, in the world. How one leads the other."""

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_MIRROR = np.array([1.0, -1.0, 1.0])  # the plane between the arms is y = 0


class Coupling(StrEnum):
    """What the other arm does when one is moved."""

    SEPARATE = "separate"  # nothing
    LINKED = "linked"  # both move as one body: turns are about the middle between them
    MIRRORED = "mirrored"  # the same, mirrored: hands that close on an object or open


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


def led(poses: Array, side: int, shift: Array, turn: Array, coupling: Coupling) -> Array:
    """Return the poses after the hand `side` was shifted by (3,), m, and turned by a quaternion, in the world."""
    moved = poses.copy()
    match coupling:
        case Coupling.SEPARATE:
            _move(moved[side], shift, turn)
        case Coupling.MIRRORED:
            _move(moved[side], shift, turn)
            _move(moved[1 - side], _MIRROR * shift, turn * np.array([1.0, -1.0, 1.0, -1.0]))
        case Coupling.LINKED:
            centre = poses[:, :3].mean(axis=0)
            for pose in moved:
                pose[:3] = centre + rotated(turn, pose[:3] - centre) + shift
                pose[3:] = product(turn, pose[3:])
    moved[:, 3:] /= np.linalg.norm(moved[:, 3:], axis=1, keepdims=True)
    return moved


def _move(pose: Array, shift: Array, turn: Array) -> None:
    pose[:3] += shift
    pose[3:] = product(turn, pose[3:])
