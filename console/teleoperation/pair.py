"""Poses of the hands, (arms, 7): position m, quaternion wxyz, in the world. How one leads the other."""

from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation

from console.teleoperation.quaternion import product
from hal.base.arrays import Array

_MIRROR = np.array([1.0, -1.0, 1.0])  # the plane between the arms is y = 0


class Coupling(StrEnum):
    """What the other arm does when one is moved."""

    SEPARATE = "separate"  # nothing
    LINKED = "linked"  # both move as one body: turns are about the middle between them
    MIRRORED = "mirrored"  # the same, mirrored: hands that close on an object or open


def led(poses: Array, side: int, shift: Array, turn: Array, coupling: Coupling) -> Array:
    """Return the poses after the hand `side` was shifted by (3,), m, and turned by a quaternion, in the world.

    side: its place in the arrays; a coupling other than SEPARATE is of two hands.
    """
    moved = poses.copy()
    match coupling:
        case Coupling.SEPARATE:
            _move(moved[side], shift, turn)
        case Coupling.MIRRORED:
            _move(moved[side], shift, turn)
            _move(moved[1 - side], _MIRROR * shift, turn * np.array([1.0, -1.0, 1.0, -1.0]))
        case Coupling.LINKED:
            centre, rotation = poses[:, :3].mean(axis=0), Rotation.from_quat(turn, scalar_first=True)
            for pose in moved:
                pose[:3] = centre + rotation.apply(pose[:3] - centre) + shift
                pose[3:] = product(turn, pose[3:])
    moved[:, 3:] /= np.linalg.norm(moved[:, 3:], axis=1, keepdims=True)
    return moved


def _move(pose: Array, shift: Array, turn: Array) -> None:
    pose[:3] += shift
    pose[3:] = product(turn, pose[3:])
