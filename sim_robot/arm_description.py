"""The arm as its URDF describes it, in the form that the plant needs."""

from dataclasses import dataclass
from functools import lru_cache
from xml.etree import ElementTree

import numpy as np

from hal.base.arrays import Array
from hal.limits import DOF
from hal.robots import RobotModel

JOINTS = DOF


@dataclass(frozen=True, slots=True)
class Capsule:
    """A capsule in its link's frame: T_link_capsule (4, 4), axis along z; radius and half length, m."""

    T_link_capsule: Array
    radius: float
    half_length: float


@dataclass(frozen=True, slots=True)
class Link:
    """One link: mass kg, centre of mass (3,) m and inertia (3, 3) kg m^2 about it, in the link's frame."""

    name: str
    mass: float
    centre: Array
    inertia: Array
    capsules: tuple[Capsule, ...]


@dataclass(frozen=True, slots=True)
class ArmDescription:
    """links: link0 (fixed) to link7; T_parent_joint: (7, 4, 4), where joint i + 1 sits on link i, axis z."""

    links: tuple[Link, ...]
    T_parent_joint: Array
    flange_offset_z: float


def _vector(text: str) -> Array:
    return np.array([float(word) for word in text.split()])


def _transform(element: ElementTree.Element) -> Array:
    """Transform of an element's origin, which every model's URDF has: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    T, origin = np.eye(4), _required(element, "origin").attrib
    (cr, cp, cy), (sr, sp, sy) = np.cos(_vector(origin["rpy"])), np.sin(_vector(origin["rpy"]))
    T[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    T[:3, 3] = _vector(origin["xyz"])
    return T


def _required(element: ElementTree.Element, path: str) -> ElementTree.Element:
    found = element.find(path)
    if found is None:
        raise ValueError(f"URDF: {element.tag} '{element.get('name')}' has no {path}")
    return found


def _link(element: ElementTree.Element) -> Link:
    inertial = _required(element, "inertial")
    pose = _transform(inertial)
    i = {key: float(value) for key, value in _required(inertial, "inertia").attrib.items()}
    tensor = np.array([[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]])
    capsules = tuple(
        Capsule(_transform(c), float(shape.attrib["radius"]), float(shape.attrib["length"]) / 2.0)
        for c in element.findall("collision")
        if (shape := c.find("geometry/cylinder")) is not None  # the spheres are the ends of these cylinders
    )
    mass, inertia = float(_required(inertial, "mass").attrib["value"]), pose[:3, :3] @ tensor @ pose[:3, :3].T
    return Link(element.attrib["name"], mass, pose[:3, 3], inertia, capsules)


@lru_cache(maxsize=32)  # an arm with a URDF of its own is a model of its own
def arm_description(model: RobotModel) -> ArmDescription:
    """Read a model's URDF. Shared: do not write."""
    root = ElementTree.fromstring(model.urdf)
    links = {link.attrib["name"]: link for link in root.findall("link")}
    joints = {joint.attrib["name"]: joint for joint in root.findall("joint")}
    chain = [joints[f"joint{i}"] for i in range(1, JOINTS + 1)]
    return ArmDescription(
        links=tuple(_link(links[f"link{i}"]) for i in range(JOINTS + 1)),
        T_parent_joint=np.array([_transform(joint) for joint in chain]),
        flange_offset_z=float(_transform(joints["joint8"])[2, 3]),
    )
