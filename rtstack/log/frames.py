"""The /tf topic: frames of both arms, their pads and the object, at 50 Hz of the robot's time.

world -> left_base -> left_link1 -> ... -> left_link8, left_base -> left_pad (from O_T_EE), the same on the
right, and world -> object. A link is given relative to the link before it: its joint's placement turned by
the joint's angle, so that no forward kinematics is needed here.
"""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import numpy as np
from foxglove.messages import FrameTransform, FrameTransforms, Quaternion, Timestamp, Vector3
from numpy.typing import NDArray

from rtstack.samples import SIDES

PERIOD_NS = 20_000_000
WORLD = "world"
OBJECT = "object"
_NS = 1_000_000_000

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CellFrames:
    """Where things are mounted in the cell. Poses (4, 4) row-major, m; the sizes are for drawing."""

    T_world_base_left: Array
    T_world_base_right: Array
    pad_size_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    object_size_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def T_world_base(self, side: str) -> Array:
        """Mounting pose of the arm of `side` (left or right), (4, 4) row-major, m."""
        return self.T_world_base_left if side == "left" else self.T_world_base_right


@dataclass(frozen=True, slots=True)
class JointPlacement:
    """A joint of the URDF: its frame in the parent link, and its axis in that frame (None: fixed)."""

    child: str
    position: Array
    orientation_wxyz: Array
    axis: Array | None


def joint_placements(urdf: str) -> tuple[JointPlacement, ...]:
    """Return the joints of a serial arm, from its base to its flange."""
    joints = []
    for joint in ElementTree.fromstring(urdf).iter("joint"):
        child, origin, axis = joint.find("child"), joint.find("origin"), joint.find("axis")
        if child is None:
            continue
        place = {} if origin is None else origin.attrib
        fixed = joint.get("type") == "fixed"
        joints.append(
            JointPlacement(
                child=child.attrib["link"],
                position=_vector(place.get("xyz", "0 0 0")),
                orientation_wxyz=_from_rpy(_vector(place.get("rpy", "0 0 0"))),
                axis=None if fixed or axis is None else _vector(axis.get("xyz", "1 0 0")),
            )
        )
    return tuple(joints)


def _vector(text: str) -> Array:
    return np.array([float(word) for word in text.split()])


def _from_rpy(rpy: Array) -> Array:
    """Quaternion wxyz of URDF's fixed-axis roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy / 2.0), np.sin(rpy / 2.0)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def _product(a: Array, b: Array) -> Array:
    """Hamilton product of two quaternions wxyz. In plain floats: numpy takes ten times as long for four numbers."""
    aw, ax, ay, az = a.tolist()
    bw, bx, by, bz = b.tolist()
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


def quaternion_of(R: Array) -> Array:
    """Return the quaternion wxyz of a rotation matrix (3, 3).

    Shepperd, "Quaternion from rotation matrix", 1978: of four equal formulas the one that divides by most.
    """
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    squares = np.array([trace, R[0, 0], R[1, 1], R[2, 2]])
    largest = int(np.argmax(squares))
    if largest == 0:
        q = np.array([1.0 + trace, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    else:
        i, j, k = ((0, 1, 2), (1, 2, 0), (2, 0, 1))[largest - 1]
        q = np.empty(4)
        q[0] = R[k, j] - R[j, k]
        q[1 + i] = 1.0 + R[i, i] - R[j, j] - R[k, k]
        q[1 + j] = R[j, i] + R[i, j]
        q[1 + k] = R[k, i] + R[i, k]
    return q / np.linalg.norm(q)


class FrameTree:
    """Makes the /tf messages of a run from batches of arm samples and object poses."""

    def __init__(self, cell: CellFrames, urdf: str) -> None:
        self._cell = cell
        self._joints = joint_placements(urdf)
        self._next_ns: int | None = None
        self._arms: dict[str, NDArray | None] = dict.fromkeys(SIDES)
        self._object: NDArray | None = None

    def update(self, arms: dict[str, NDArray], poses: NDArray) -> list[tuple[int, bytes]]:
        """Return the messages that are due in a batch, as (t_ns, FrameTransforms).

        arms: the batch's ARM_SAMPLE records of each side; poses: its OBJECT_POSE records. The first side that
        has samples sets the times; everything else is the newest that was seen until then.
        """
        leader = next((arms[side] for side in SIDES if len(arms[side])), arms[SIDES[0]])
        messages = []
        for row in self._due(leader["t_ns"]):
            t_ns = int(leader["t_ns"][row])
            for side in SIDES:
                self._arms[side] = _newest(arms[side], t_ns, self._arms[side])
            self._object = _newest(poses, t_ns, self._object)
            messages.append((t_ns, self._message(t_ns)))
        for side in SIDES:
            self._arms[side] = arms[side][-1:] if len(arms[side]) else self._arms[side]
        self._object = poses[-1:] if len(poses) else self._object
        return messages

    def _due(self, t_ns: NDArray[np.int64]) -> list[int]:
        rows = []
        for row, t in enumerate(t_ns.tolist()):
            if self._next_ns is None or t >= self._next_ns:
                rows.append(row)
                self._next_ns = (t // PERIOD_NS + 1) * PERIOD_NS
        return rows

    def _message(self, t_ns: int) -> bytes:
        stamp = Timestamp(t_ns // _NS, t_ns % _NS)
        transforms = []
        for side in SIDES:
            sample = self._arms[side]
            if sample is None:
                continue
            base = f"{side}_base"
            transforms.append(_transform(stamp, WORLD, base, *_pose_of(self._cell.T_world_base(side))))
            parent, angles = base, iter(sample["q"][0])
            for joint in self._joints:
                turned = joint.orientation_wxyz
                if joint.axis is not None:
                    half = 0.5 * float(next(angles))
                    turned = _product(turned, np.array([np.cos(half), *(np.sin(half) * joint.axis)]))
                child = f"{side}_{joint.child}"
                transforms.append(_transform(stamp, parent, child, joint.position, turned))
                parent = child
            transforms.append(_transform(stamp, base, f"{side}_pad", *_pose_of(sample["O_T_EE"][0])))
        if self._object is not None:
            pose = self._object[0]
            transforms.append(_transform(stamp, WORLD, OBJECT, pose["position"], pose["orientation_wxyz"]))
        return FrameTransforms(transforms=transforms).encode()


def _newest(records: NDArray, t_ns: int, before: NDArray | None) -> NDArray | None:
    count = int(np.searchsorted(records["t_ns"], t_ns, side="right"))
    return records[count - 1 : count] if count else before


def _pose_of(T: Array) -> tuple[Array, Array]:
    return T[:3, 3], quaternion_of(T[:3, :3])


def _transform(stamp: Timestamp, parent: str, child: str, position: Array, wxyz: Array) -> FrameTransform:
    x, y, z = position.tolist()
    qw, qx, qy, qz = wxyz.tolist()
    return FrameTransform(
        timestamp=stamp,
        parent_frame_id=parent,
        child_frame_id=child,
        translation=Vector3(x=x, y=y, z=z),
        rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
    )
