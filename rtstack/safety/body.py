"""The judge's own picture of an arm, from hal's description: joints for its forward kinematics, links as capsules.

Every collision cylinder of the URDF has a sphere at each end: a capsule. The pad on the flange is one more, which
contains its box. Nothing here comes from the controller's model.
"""

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.compilation import fields
from hal.limits import DOF
from hal.robots import FR3, RobotModel
from hal.robots.description import LARGEST_NUMBER_OF_CAPSULES

LINKS = DOF + 1  # link0 to link7
CAPSULES = LARGEST_NUMBER_OF_CAPSULES + 1  # room for those of the links, and one for the pad

# translation and rotation: of each joint's frame in its predecessor's. first[l] to first[l + 1]: the capsules of
# link l, first[LINKS]: how many there are. ends: a capsule's axis in its link's frame, m; reach: from its middle to its
# furthest point, m
BODY = np.dtype(
    [
        *fields("f8", "base_position face", 3),
        ("base_rotation", "f8", (3, 3)),
        ("translation", "f8", (7, 3)),
        ("rotation", "f8", (7, 3, 3)),
        ("first", "i8", LINKS + 1),
        ("ends", "f8", (CAPSULES, 2, 3)),
        *fields("f8", "radius reach", CAPSULES),
    ]
)


@dataclass(frozen=True, slots=True)
class Base:
    """Which arm stands where in the world: m, and a quaternion wxyz. Raises ValueError for what is no place: no line
    of the judge would be crossed there."""

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    robot: RobotModel = FR3

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, self.position)):
            raise ValueError(f"base_position = {list(self.position)}: must be finite")
        if not 1e-6 < math.hypot(*self.orientation_wxyz) < math.inf:
            raise ValueError(f"base_orientation_wxyz = {list(self.orientation_wxyz)}: not a quaternion")


@dataclass(frozen=True, slots=True)
class Tool:
    """The pad on the flange: a box, m; the middle of its outer face is at (offset_xy, flange_to_face), m, and looks
    along its z, turned by a quaternion wxyz, in the flange's frame. Raises ValueError."""

    size: tuple[float, float, float] = (0.1, 0.1, 0.03)
    flange_to_face: float = 0.03
    offset_xy: tuple[float, float] = (0.0, 0.0)
    orientation_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not all(0.0 < length < math.inf for length in self.size):
            raise ValueError(f"size = {list(self.size)}: must be positive and finite")
        if not math.isfinite(self.flange_to_face):
            raise ValueError(f"flange_to_face = {self.flange_to_face}: must be finite")
        if not all(map(math.isfinite, self.offset_xy)):
            raise ValueError(f"offset_xy = {list(self.offset_xy)}: must be finite")
        if not 1e-6 < math.hypot(*self.orientation_wxyz) < math.inf:
            raise ValueError(f"orientation_wxyz = {list(self.orientation_wxyz)}: not a quaternion")


def arm_body(base: Base, tool: Tool) -> NDArray[np.void]:
    """Return the BODY () of an arm with the tool on this base."""
    root = ElementTree.fromstring(base.robot.urdf)
    body = np.zeros((), BODY)
    body["base_position"] = base.position
    body["base_rotation"] = rotation_from_quaternion(np.array(base.orientation_wxyz))
    for i in range(DOF):
        origin = root.find(f"joint[@name='joint{i + 1}']/origin")
        body["translation"][i], body["rotation"][i] = _numbers(origin, "xyz"), _turn(_numbers(origin, "rpy"))
    flange = _numbers(root.find("joint[@name='joint8']/origin"), "xyz")
    body["face"] = flange + (*tool.offset_xy, tool.flange_to_face)
    count = 0
    for link in range(LINKS):
        body["first"][link] = count
        for collision in root.findall(f"link[@name='link{link}']/collision"):
            cylinder = collision.find("geometry/cylinder")
            if cylinder is not None:
                origin = collision.find("origin")
                along = _turn(_numbers(origin, "rpy"))[:, 2] * float(cylinder.attrib["length"]) / 2
                middle = _numbers(origin, "xyz")
                _add(body, count, middle - along, middle + along, float(cylinder.attrib["radius"]))
                count += 1
    width, depth, height = tool.size
    turn = rotation_from_quaternion(np.array(tool.orientation_wxyz))
    middle, half = body["face"] - turn[:, 2] * (height / 2), turn[:, 0] * (width / 2)
    _add(body, count, middle - half, middle + half, math.hypot(depth / 2, height / 2))
    body["first"][LINKS] = count + 1
    return body


def _add(body: NDArray[np.void], index: int, a: Array, b: Array, radius: float) -> None:
    body["ends"][index] = a, b
    body["radius"][index] = radius
    body["reach"][index] = radius + np.linalg.norm(b - a) / 2


def _numbers(element: ElementTree.Element | None, name: str) -> Array:
    text = element.attrib[name] if element is not None else ""
    return np.array([float(word) for word in text.split()])


def _turn(rpy: Array) -> Array:
    """Return the rotation (3, 3) of URDF's roll, pitch and yaw: about z, then y, then x."""
    (a, b, c), (x, y, z) = np.sin(rpy), np.cos(rpy)
    roll = np.array([[1, 0, 0], [0, x, -a], [0, a, x]])
    pitch = np.array([[y, 0, b], [0, 1, 0], [-b, 0, y]])
    yaw = np.array([[z, -c, 0], [c, z, 0], [0, 0, 1]])
    return yaw @ pitch @ roll


def rotation_from_quaternion(q: Array) -> NDArray[np.float64]:
    """Return the rotation (3, 3) of a quaternion wxyz (4,), normalised first. Not for the tick."""
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
