"""Where two bodies touch: the corner points of the area in which two plane faces overlap."""

from dataclasses import dataclass

import numpy as np

from hal.base.arrays import Array

# m: faces further apart than this do not touch, nor corners of a face that is tilted by more
GAP = 0.01
FACING = -0.9  # cosine of the angle between two normals, below which the faces face each other: 26 degrees


@dataclass(frozen=True, slots=True)
class Face:
    """A plane rectangle: centre (3,) m, axes (3, 3) whose third column is the outward normal, half its size (2,) m."""

    centre: Array
    axes: Array
    half: Array

    def corners(self) -> Array:
        """Return the corners in turn, (4, 3) m."""
        return self.centre + (_TURN * self.half) @ self.axes[:, :2].T


@dataclass(frozen=True, slots=True)
class Patch:
    """Contact points (n, 3) m, all with one frame (3, 3): two tangents, then the normal, to the first body."""

    points: Array
    frame: Array


_TURN = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])


def box_face(position: Array, rotation: Array, size: Array, towards: Array) -> Face:
    """Return the face of a box, whose centre is at position, that looks most in the direction `towards` (3,)."""
    along = (towards @ rotation).tolist()
    axis = max(range(3), key=lambda k: abs(along[k]))
    sign = 1.0 if along[axis] > 0.0 else -1.0
    u, v = (axis + 1) % 3, (axis + 2) % 3
    axes = np.empty((3, 3))
    axes[:, 0] = sign * rotation[:, u]
    axes[:, 1] = rotation[:, v]
    axes[:, 2] = sign * rotation[:, axis]
    return Face(position + axes[:, 2] * (size[axis] / 2), axes, np.array([size[u] / 2, size[v] / 2]))


def face_on_face(first: Face, second: Face) -> Patch | None:
    """Return where `first` lies on `second`, in the plane of `second`; None where they do not touch."""
    offset = first.corners() - second.centre
    if first.axes[:, 2] @ second.axes[:, 2] > FACING or abs(float(offset.mean(axis=0) @ second.axes[:, 2])) > GAP:
        return None
    polygon = _clipped(offset @ second.axes[:, :2], second.half)
    if len(polygon) < 3:
        return None
    return Patch(second.centre + polygon @ second.axes[:, :2].T, second.axes)


def face_on_plane(face: Face, point: Array, normal: Array) -> Patch | None:
    """Return the corners of a face that lie on a plane, at most GAP away from it; None where there is none."""
    n = normal / np.linalg.norm(normal)
    corners = face.corners()
    height = (corners - point) @ n
    touching = np.abs(height) <= GAP
    if not touching.any():
        return None
    return Patch((corners - np.outer(height, n))[touching], frame_of(n))


def frame_of(normal: Array) -> Array:
    """Return a rotation (3, 3) whose third column is the direction of `normal` (Duff et al., JCGT 2017)."""
    x, y, z = (normal / np.linalg.norm(normal)).tolist()
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array([[1.0 + sign * x * x * a, b, x], [sign * b, sign + y * y * a, y], [-sign * x, -y, z]])


def _clipped(polygon: Array, half: Array) -> Array:
    """Return the part of a convex polygon (n, 2) within |x| <= half[0], |y| <= half[1] (Sutherland and Hodgman)."""
    if np.all(np.abs(polygon) <= half):
        return polygon
    for axis in (0, 1):
        for sign in (1.0, -1.0):
            depth = half[axis] - sign * polygon[:, axis]
            kept = []
            for i in range(len(polygon)):
                j = (i + 1) % len(polygon)
                if depth[i] >= 0.0:
                    kept.append(polygon[i])
                if depth[i] * depth[j] < 0.0:
                    kept.append(polygon[i] + (polygon[j] - polygon[i]) * depth[i] / (depth[i] - depth[j]))
            polygon = np.array(kept).reshape(-1, 2)
            if len(polygon) == 0:
                return polygon
    return polygon
