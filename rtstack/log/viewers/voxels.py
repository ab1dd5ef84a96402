"""The topics /shapes/BODY: the solids of each body as voxels in its frame of /tf, which Rerun's importer draws.

It ignores foxglove.SceneUpdate (rerun-sdk 0.41), and keeps one value a topic. Said once: the grids move with frames.
"""

from functools import lru_cache

import numpy as np
from foxglove.messages import Pose, VoxelGrid
from numpy.typing import NDArray

from hal.base.arrays import Array
from rtstack.log.viewers.frames import OBJECT, TABLE, from_rpy, rotation_of, stamp
from rtstack.log.viewers.shapes import colour_fields, pose, vector
from rtstack.log.viewers.solids import Shape
from rtstack.samples import SIDES

CELL_M = 0.02  # of a link's voxels: below the least radius of the arm's URDF, 25 mm
PREFIX = "/shapes"
_LINKS = (*(f"link{k}" for k in range(8)), "pad")
VOXELS: tuple[str, ...] = tuple(
    f"{PREFIX}/{body}" for body in (*(f"{side}_{link}" for side in SIDES for link in _LINKS), TABLE, OBJECT)
)


def voxel_messages(shapes: list[Shape], t_ns: int) -> dict[str, bytes]:
    """Return a VoxelGrid by topic for every body that has solids, at t_ns."""
    bodies: dict[str, list[Shape]] = {}
    for shape in shapes:
        bodies.setdefault(shape.link, []).append(shape)
    return {f"{PREFIX}/{body}": _grid(body, tuple(solids), t_ns) for body, solids in bodies.items()}


@lru_cache(maxsize=4 * len(VOXELS))
def _grid(body: str, solids: tuple[Shape, ...], t_ns: int) -> bytes:
    if len(solids) == 1 and solids[0].kind == "box":
        (box,) = solids
        # exact: a single voxel, counted from the box's lowest corner
        wxyz, size, filled = from_rpy(np.array(box.rpy)), np.array(box.size), np.ones((1, 1, 1), bool)
        where = pose(np.array(box.position) - 0.5 * rotation_of(wxyz) @ size, wxyz)
    else:
        where, size, filled = _filled(solids)
    rows = filled.shape  # slices along z, rows along y, columns along x
    data = np.zeros((*rows, 4), np.uint8)  # nothing: fully transparent
    data[filled] = [round(255 * part) for part in solids[0].colour]
    return VoxelGrid(
        timestamp=stamp(t_ns), frame_id=body, pose=where, row_count=rows[1], column_count=rows[2],
        cell_size=vector(size), slice_stride=4 * rows[1] * rows[2], row_stride=4 * rows[2], cell_stride=4,
        fields=colour_fields(0), data=data.tobytes(),
    ).encode()  # fmt: skip


def _filled(solids: tuple[Shape, ...]) -> tuple[Pose, Array, NDArray[np.bool_]]:
    """Pose and cell size, m, of a grid along the link's axes; (z, y, x): whether a cell's centre is in a solid."""
    turns = [rotation_of(from_rpy(np.array(solid.rpy))) for solid in solids]
    centres, halves = (np.array([getattr(s, name) for s in solids]) for name in ("position", "size"))
    halves = 0.5 * halves
    reach = np.array([np.abs(R) @ half for R, half in zip(turns, halves, strict=True)])
    low, high = (centres - reach).min(axis=0), (centres + reach).max(axis=0)
    count = np.maximum(1, np.round((high - low) / CELL_M).astype(int))
    size = (high - low) / count
    axes = [low[k] + (np.arange(count[k]) + 0.5) * size[k] for k in range(3)]
    z, y, x = np.meshgrid(*reversed(axes), indexing="ij")
    points = np.stack([x, y, z], axis=-1)
    filled = np.zeros(points.shape[:3], bool)
    for solid, R, centre, half in zip(solids, turns, centres, halves, strict=True):
        p = (points - centre) @ R / half
        if solid.kind == "box":
            filled |= (np.abs(p) <= 1.0).all(axis=-1)
        elif solid.kind == "cylinder":
            filled |= (np.hypot(p[..., 0], p[..., 1]) <= 1.0) & (np.abs(p[..., 2]) <= 1.0)
        else:
            filled |= np.linalg.norm(p, axis=-1) <= 1.0
    return pose(low), size, filled
