"""The topics /scene and /forces: what a viewer of foxglove.SceneUpdate draws, solids in their frames and arrows.

The solids move with the frames of /tf: they are said once a second, for a reader that begins late, the arrows always.
"""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from foxglove import messages as fox
from numpy.typing import NDArray

from rtstack.log.viewers.frames import WORLD, CellFrames, Instants, from_rpy, stamp
from rtstack.log.viewers.solids import Shape

SOLIDS_PERIOD_NS = 1_000_000_000
M_PER_N = 0.004  # of an arrow: a squeeze of 30 N is 12 cm
LEAST_N = 1.0  # less is the estimate's noise, and no arrow
POINTS = 24  # of a force's line, for viewers without arrows
_ARROW = {"shaft_diameter": 0.012, "head_length": 0.03, "head_diameter": 0.03}  # m
_FORCE_COLOURS = {"left": (0.85, 0.20, 0.20), "right": (0.20, 0.35, 0.90)}
# kind of a Shape -> what an entity calls those, the message, what it has besides
_SOLIDS: dict[str, tuple[str, Any, dict[str, float]]] = {
    "box": ("cubes", fox.CubePrimitive, {}), "sphere": ("spheres", fox.SpherePrimitive, {}),
    "cylinder": ("cylinders", fox.CylinderPrimitive, {"bottom_scale": 1.0, "top_scale": 1.0}),
}  # fmt: skip
_POINT = np.dtype([("xyz", "<f4", 3), ("rgba", "u1", 4)])


class Solids:
    """Makes the /scene messages of a run: one entity a link, which moves with its frame."""

    def __init__(self, shapes: list[Shape]) -> None:
        self._shapes: dict[str, list[Shape]] = {}
        for shape in shapes:
            self._shapes.setdefault(shape.link, []).append(shape)
        self._next_ns: int | None = None

    def updates(self, instants: Instants) -> list[tuple[int, bytes]]:
        """Return the messages that are due, as (t_ns, SceneUpdate)."""
        due = []
        for t in instants.t_ns.tolist():
            if self._next_ns is None or t >= self._next_ns:
                self._next_ns = (t // SOLIDS_PERIOD_NS + 1) * SOLIDS_PERIOD_NS
                now = stamp(t)
                entities = [
                    fox.SceneEntity(timestamp=now, frame_id=link, id=link, frame_locked=True, **_primitives(shapes))
                    for link, shapes in self._shapes.items()
                ]
                due.append((t, fox.SceneUpdate(entities=entities).encode()))
        return due


def _primitives(shapes: list[Shape]) -> dict[str, Any]:
    found: dict[str, Any] = {name: [] for name, *_ in _SOLIDS.values()}
    for s in (each for each in shapes if each.kind in _SOLIDS):
        name, solid, more = _SOLIDS[s.kind]
        place, colour = pose(s.position, from_rpy(np.array(s.rpy))), dict(zip("rgba", s.colour, strict=True))
        found[name].append(solid(pose=place, size=vector(s.size), color=fox.Color(**colour), **more))
    return found


def force_messages(cell: CellFrames, instants: Instants) -> tuple[list[tuple[int, bytes]], list[tuple[int, bytes]]]:
    """Return the forces by which the pads push their environment, for each of the instants: arrows, (t_ns, SceneUpdate)
    each, and lines of points, (t_ns, PointCloud) each."""
    n = len(instants.t_ns)
    entities: list[list[fox.SceneEntity]] = [[] for _ in range(n)]
    points: list[list[bytes]] = [[] for _ in range(n)]
    stamps = instants.stamps()
    for side, T in cell.T_world_base.items():
        known = instants.known.get(side)
        if known is None:
            continue
        face = known.records["O_T_EE"][:, :3, 3] @ T[:3, :3].T + T[:3, 3]
        force = known.records["O_F_ext_hat_K"][:, :3] @ T[:3, :3].T
        for row, p, F in zip(known.rows.tolist(), face, force, strict=True):
            newton = math.hypot(*F)
            about = {"timestamp": stamps[row], "frame_id": WORLD, "id": f"{side}_force"}
            arrows = [_arrow(side, p, F, newton)] if newton >= LEAST_N else []
            entities[row].append(fox.SceneEntity(**about, arrows=arrows))
            points[row].append(_line(side, p, F) if arrows else b"")
    times = instants.t_ns.tolist()
    arrows = [(t, fox.SceneUpdate(entities=e).encode()) for t, e in zip(times, entities, strict=True)]
    return arrows, [(t, _cloud(now, b"".join(p))) for t, now, p in zip(times, stamps, points, strict=True)]


def _arrow(side: str, start: NDArray[np.float64], force: NDArray[np.float64], newton: float) -> fox.ArrowPrimitive:
    x, y, z = (force / newton).tolist()
    # the shortest turn from +x, along which an arrow points, to the force; from -x half a turn about z
    w, turned = 1.0 + x, (0.0, -z, y)
    q = (w, *turned) if w > 1e-9 else (0.0, 0.0, 0.0, 1.0)
    norm = math.sqrt(sum(part * part for part in q))  # not by BLAS, whose last bit is the processor's
    turn = pose(start, [part / norm for part in q])
    red, green, blue = _FORCE_COLOURS[side]
    length = max(0.0, M_PER_N * newton - _ARROW["head_length"])
    return fox.ArrowPrimitive(pose=turn, shaft_length=length, color=fox.Color(r=red, g=green, b=blue, a=1.0), **_ARROW)


def _line(side: str, start: NDArray[np.float64], force: NDArray[np.float64]) -> bytes:
    points = np.zeros(POINTS, _POINT)
    points["xyz"] = start + np.linspace(0.0, M_PER_N, POINTS)[:, None] * force
    points["rgba"] = [*(round(255 * part) for part in _FORCE_COLOURS[side]), 255]
    return points.tobytes()


def colour_fields(offset: int) -> list[fox.PackedElementField]:
    """Return the fields of a colour's four bytes, from this byte of a point or cell on."""
    names, kind = ("red", "green", "blue", "alpha"), fox.PackedElementFieldNumericType.Uint8
    return [fox.PackedElementField(name=name, offset=offset + k, type=kind) for k, name in enumerate(names)]


def _cloud(now: fox.Timestamp, data: bytes) -> bytes:
    kind = fox.PackedElementFieldNumericType.Float32
    fields = [fox.PackedElementField(name=name, offset=4 * k, type=kind) for k, name in enumerate("xyz")]
    return fox.PointCloud(
        timestamp=now, frame_id=WORLD, pose=pose((0.0, 0.0, 0.0)), point_stride=_POINT.itemsize,
        fields=fields + colour_fields(12), data=data,
    ).encode()  # fmt: skip


def pose(position: Iterable[float], wxyz: Iterable[float] = (1.0, 0.0, 0.0, 0.0)) -> fox.Pose:
    """Return a place (3,), m, and a quaternion (4,) as Foxglove has them."""
    w, x, y, z = map(float, wxyz)
    return fox.Pose(position=vector(position), orientation=fox.Quaternion(x=x, y=y, z=z, w=w))


def vector(values: Iterable[float]) -> fox.Vector3:
    x, y, z = map(float, values)
    return fox.Vector3(x=x, y=y, z=z)
