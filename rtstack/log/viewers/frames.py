"""The /tf topic: frames of both arms, their pads, table and object, at 50 Hz of the robot's time.

world -> left_base -> left_link0 -> left_link1 -> ... -> left_link8, left_base -> left_pad (from O_T_EE), the same on
the right, world -> table, and world -> object: what rtstack.log.viewers.solids hang in. A link is given relative to
the link before it: its joint's placement turned by the joint's angle, so that no forward kinematics is needed here.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from foxglove.messages import FrameTransform, FrameTransforms, Quaternion, Timestamp, Vector3
from numpy.typing import NDArray

from hal.base.arrays import Array
from rtstack.samples import SIDES

PERIOD_NS = 20_000_000  # of the instants at which a log shows the cell: 50 a second of the robot's time
OBJECT = "object"
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Known:
    """What was known of an arm or of the object: at which of the instants, (m,), and the newest records then, (m,)."""

    rows: NDArray[np.intp]
    records: NDArray


@dataclass(frozen=True, slots=True)
class Instants:
    """Instants (n,), ns, and what was known then of left, right and object; what was never seen is left out."""

    t_ns: NDArray[np.int64]
    known: dict[str, Known]

    def stamps(self, rows: NDArray[np.intp] | None = None) -> list[Timestamp]:
        return [stamp(t) for t in (self.t_ns if rows is None else self.t_ns[rows]).tolist()]


def stamp(t_ns: int) -> Timestamp:
    """Return a time as a time stamp; what was before the robot's zero is at zero."""
    t_ns = max(t_ns, 0)
    return Timestamp(t_ns // _NS, t_ns % _NS)


class InstantFinder:
    """Finds the instants in a run's batches of arm samples and object poses."""

    def __init__(self) -> None:
        self._next_ns: int | None = None
        self._held: dict[str, NDArray] = {}  # of each arm, and of the object: the newest record of the batches so far

    def find(self, arms: dict[str, NDArray], poses: NDArray) -> Instants:
        """Return the instants in a batch of ARM_SAMPLE records of each side and OBJECT_POSE records.

        The first side that has samples sets the times; everything else is the newest that was seen until then.
        """
        leader = next((arms[side] for side in SIDES if len(arms[side])), arms[SIDES[0]])
        due = np.array(self._due(leader["t_ns"]), np.int64)
        found: dict[str, Known] = {}
        for name, records in (*((side, arms[side]) for side in SIDES), (OBJECT, poses)):
            held = self._held.get(name, records[:0])
            known = np.concatenate([held, records]) if len(held) else records
            self._held[name] = known[-1:].copy()
            count = np.maximum(np.searchsorted(known["t_ns"], due, side="right"), len(held))
            seen = np.flatnonzero(count)
            if len(seen):
                found[name] = Known(seen, known[count[seen] - 1])
        return Instants(due, found)

    def _due(self, t_ns: NDArray[np.int64]) -> list[int]:
        times = []
        for t in t_ns.tolist():
            if self._next_ns is None or t >= self._next_ns:
                times.append(t)
                self._next_ns = (t // PERIOD_NS + 1) * PERIOD_NS
        return times


WORLD = "world"
TABLE = "table"
BASE_LINK = "link0"  # of the arm's URDF
_UPRIGHT, _NONE = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(4)


@dataclass(frozen=True, slots=True, eq=False)
class CellFrames:
    """Where things are mounted in the cell, compared by identity.

    Of each arm that is there, by its side, left before right: mounting pose (4, 4) row-major, m, size of its pad, m,
    and URDF. The sizes are for drawing.
    """

    T_world_base: Mapping[str, Array]
    pad_size_m: Mapping[str, tuple[float, float, float]]
    urdf: Mapping[str, str]
    object_size_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    table_centre_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    table_size_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def sides(self) -> tuple[str, ...]:
        return tuple(self.T_world_base)


@dataclass(frozen=True, slots=True)
class JointPlacement:
    """A joint of the URDF: its frame in the parent link, and its axis in that frame (None: fixed)."""

    child: str
    position: Array
    orientation_wxyz: Array
    axis: Array | None


@lru_cache(maxsize=8)
def joint_placements(urdf: str) -> tuple[JointPlacement, ...]:
    """Return the joints of a serial arm, from its base to its flange."""
    joints = []
    for joint in ElementTree.fromstring(urdf).iter("joint"):
        child, origin, axis = joint.find("child"), joint.find("origin"), joint.find("axis")
        if child is None:
            continue
        place = {} if origin is None else origin.attrib
        xyz, rpy = (np.array(triple(place.get(name, "0 0 0"))) for name in ("xyz", "rpy"))
        about = None if joint.get("type") == "fixed" or axis is None else np.array(triple(axis.get("xyz", "1 0 0")))
        joints.append(JointPlacement(child.attrib["link"], xyz, from_rpy(rpy), about))
    return tuple(joints)


def triple(text: str) -> tuple[float, float, float]:
    x, y, z = map(float, text.split())
    return x, y, z


def from_rpy(rpy: Array) -> Array:
    """Quaternion wxyz of URDF's fixed-axis roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy / 2.0), np.sin(rpy / 2.0)
    return np.array([
        cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy,
    ])  # fmt: skip


def rotation_of(wxyz: Array) -> Array:
    """Rotation matrix (3, 3) of a unit quaternion."""
    w, (x, y, z) = wxyz[0], wxyz[1:]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * (w * cross + cross @ cross)


def _products(a: Array, b: Array) -> Array:
    """Hamilton products of a quaternion a (4,) and quaternions b (n, 4), all wxyz."""
    aw, ax, ay, az = a.tolist()
    bw, bx, by, bz = b.T
    return np.column_stack([
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ])  # fmt: skip


def quaternions_of(R: Array, before: Array = _NONE) -> Array:
    """Return the quaternions wxyz (n, 4) of a moving frame's rotation matrices (n, 3, 3), without jumps of their sign,
    also from the one before, (4,), zeros where there is none.

    Shepperd, "Quaternion from rotation matrix", 1978: of four equal formulas the one that divides by most.
    """
    diagonal = np.diagonal(R, axis1=1, axis2=2)
    trace = diagonal.sum(axis=1)
    largest = np.argmax(np.column_stack([trace, diagonal]), axis=1)
    formulas = np.empty((len(R), 4, 4))
    formulas[:, 0, 0], formulas[:, 1:, 1:] = 1.0 + trace, R + R.transpose(0, 2, 1)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        formulas[:, 0, 1 + i] = formulas[:, 1 + i, 0] = R[:, k, j] - R[:, j, k]
        formulas[:, 1 + i, 1 + i] = 1.0 + R[:, i, i] - R[:, j, j] - R[:, k, k]
    q = formulas[np.arange(len(R)), largest]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    turned = np.einsum("ij,ij->i", q, np.vstack([before, q])[:-1]) < 0.0
    return q * np.cumprod(np.where(turned, -1.0, 1.0))[:, None]


@dataclass(frozen=True, slots=True)
class _Track:
    """A frame in its parent at the times of several messages: position (n, 3) or (3,), quaternion wxyz alike."""

    parent: str
    child: str
    position: Array
    wxyz: Array

    def transforms(self, stamps: list[Timestamp]) -> list[FrameTransform]:
        n = len(stamps)
        positions, quaternions = (np.broadcast_to(a, (n, a.shape[-1])).tolist() for a in (self.position, self.wxyz))
        return [
            FrameTransform(
                timestamp=stamp, parent_frame_id=self.parent, child_frame_id=self.child,
                translation=Vector3(x=x, y=y, z=z), rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
            )
            for stamp, (x, y, z), (qw, qx, qy, qz) in zip(stamps, positions, quaternions, strict=True)
        ]  # fmt: skip


class FrameTree:
    """Makes the /tf messages of a run."""

    def __init__(self, cell: CellFrames) -> None:
        self._cell = cell
        self._joints = {side: joint_placements(cell.urdf[side]) for side in cell.sides}
        self._turned = {side: np.zeros(4) for side in cell.sides}  # the pads, at last

    def transforms(self, instants: Instants) -> list[tuple[int, bytes]]:
        """Return a message for each of the instants, as (t_ns, FrameTransforms)."""
        frames: list[list[FrameTransform]] = [[] for _ in instants.t_ns]
        tracks: list[tuple[NDArray[np.intp], list[_Track]]] = []
        if any(self._cell.table_size_m):
            table = _Track(WORLD, TABLE, np.array(self._cell.table_centre_m), _UPRIGHT)
            tracks.append((np.arange(len(frames)), [table]))
        for name, known in instants.known.items():
            tracks.append((known.rows, self._tracks(name, known.records)))
        for rows, moving in tracks:
            stamps = instants.stamps(rows)
            for track in moving:
                for row, transform in zip(rows.tolist(), track.transforms(stamps), strict=True):
                    frames[row].append(transform)
        return [
            (t, FrameTransforms(transforms=transforms).encode())
            for t, transforms in zip(instants.t_ns.tolist(), frames, strict=True)
        ]

    def _tracks(self, side: str, samples: NDArray) -> list[_Track]:
        if side == OBJECT:
            return [_Track(WORLD, OBJECT, samples["position"], samples["orientation_wxyz"])]
        base = f"{side}_base"
        tracks = [_Track(WORLD, base, *_poses_of(self._cell.T_world_base[side][None]))]
        parent, angles = f"{side}_{BASE_LINK}", iter(0.5 * samples["q"].T)
        tracks.append(_Track(base, parent, np.zeros(3), _UPRIGHT))
        for joint in self._joints[side]:
            turned = joint.orientation_wxyz
            if joint.axis is not None:
                half = next(angles)
                turned = _products(turned, np.column_stack([np.cos(half), np.sin(half)[:, None] * joint.axis]))
            child = f"{side}_{joint.child}"
            tracks.append(_Track(parent, child, joint.position, turned))
            parent = child
        position, wxyz = _poses_of(samples["O_T_EE"], self._turned[side])
        self._turned[side] = wxyz[-1] if len(wxyz) else self._turned[side]
        return [*tracks, _Track(base, f"{side}_pad", position, wxyz)]


def _poses_of(T: Array, before: Array = _NONE) -> tuple[Array, Array]:
    return T[:, :3, 3], quaternions_of(T[:, :3, :3], before)
