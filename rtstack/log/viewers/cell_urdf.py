"""The whole cell as one URDF whose links are the frames of /tf: the solids that viewers draw are taken from it.

Both arms with their pads, table and object. Where a link is, /tf says; the joints only say what hangs on what.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from hal.base.arrays import Array
from rtstack.log.viewers.frames import BASE_LINK, TABLE, WORLD, CellFrames, quaternions_of
from rtstack.log.viewers.instants import OBJECT

# red, green, blue, alpha: what is squeezed lets the forces be seen
COLOURS: dict[str, tuple[float, float, float, float]] = {
    "arm": (0.88, 0.89, 0.91, 1.0),
    "pad": (0.16, 0.17, 0.19, 1.0),
    "table": (0.55, 0.50, 0.44, 1.0),
    "object": (0.85, 0.65, 0.25, 0.45),
}


@dataclass(frozen=True, slots=True)
class Shape:
    """A solid of a link: box (x, y, z), cylinder (diameter, diameter, length) or sphere (diameter, ...), m."""

    link: str
    kind: str
    position: tuple[float, float, float]
    rpy: tuple[float, float, float]
    size: tuple[float, float, float]
    colour: tuple[float, float, float, float]


def cell_urdf(cell: CellFrames) -> str:
    """Return the URDF of a cell with its arms. Things without a size are left out."""
    robot = Element("robot", name="cell")
    for name, colour in COLOURS.items():
        SubElement(SubElement(robot, "material", name=name), "color", rgba=_numbers(colour))
    SubElement(robot, "link", name=WORLD)
    for side in cell.sides:
        size = cell.pad_size_m[side]
        _add_arm(robot, side, cell.T_world_base[side], cell.urdf[side])
        pad = f"{side}_pad"
        # the frame is in the pad's outer face
        _add_box(robot, pad, size, "pad", (0.0, 0.0, -0.5 * size[2]))
        _add_joint(robot, f"{side}_base", pad, "floating")
    if any(cell.table_size_m):
        _add_box(robot, TABLE, cell.table_size_m, "table")
        _add_joint(robot, WORLD, TABLE, "fixed", cell.table_centre_m)
    if any(cell.object_size_m):
        _add_box(robot, OBJECT, cell.object_size_m, "object")
        _add_joint(robot, WORLD, OBJECT, "floating")
    return ElementTree.tostring(robot, encoding="unicode")


def shapes_of(urdf: str) -> list[Shape]:
    """Return the solids that a URDF shows."""
    robot = ElementTree.fromstring(urdf)
    colours = {
        material.attrib["name"]: _colour(color.attrib["rgba"])
        for material in robot.findall("material")
        if (color := material.find("color")) is not None
    }
    shapes = []
    for link in robot.findall("link"):
        for visual in link.findall("visual"):
            geometry, origin, material = visual.find("geometry"), visual.find("origin"), visual.find("material")
            place = {} if origin is None else origin.attrib
            for solid in () if geometry is None else geometry:
                colour = colours.get("" if material is None else material.attrib["name"], COLOURS["arm"])
                shapes.append(
                    Shape(
                        link.attrib["name"],
                        solid.tag,
                        _vector(place.get("xyz", "0 0 0")),
                        _vector(place.get("rpy", "0 0 0")),
                        _size(solid),
                        colour,
                    )
                )
    return shapes


def _size(solid: Element) -> tuple[float, float, float]:
    if solid.tag == "box":
        return _vector(solid.attrib["size"])
    width = 2.0 * float(solid.attrib["radius"])
    return (width, width, float(solid.get("length", width)))


def _add_arm(robot: Element, side: str, T_world_base: Array, arm_urdf: str) -> None:
    base = f"{side}_base"
    SubElement(robot, "link", name=base)
    _add_joint(robot, WORLD, base, "fixed", T_world_base[:3, 3].tolist(), _rpy(T_world_base[:3, :3]))
    _add_joint(robot, base, f"{side}_{BASE_LINK}", "fixed")
    for element in ElementTree.fromstring(arm_urdf):
        if element.tag not in ("link", "joint"):
            continue
        for named in (element, *element.findall("parent"), *element.findall("child")):
            key = "link" if named is not element else "name"
            named.set(key, f"{side}_{named.attrib[key]}")
        for unseen in element.findall("collision"):
            element.remove(unseen)
        for visual in element.findall("visual"):
            if visual.find("material") is None:
                SubElement(visual, "material", name="arm")
        robot.append(element)


def _add_box(
    robot: Element, link: str, size: Sequence[float], material: str, centre: Sequence[float] = (0.0, 0.0, 0.0)
) -> None:
    added = SubElement(robot, "link", name=link)
    if any(size):
        visual = SubElement(added, "visual")
        SubElement(visual, "origin", xyz=_numbers(centre), rpy="0 0 0")
        SubElement(SubElement(visual, "geometry"), "box", size=_numbers(size))
        SubElement(visual, "material", name=material)


def _add_joint(
    robot: Element,
    parent: str,
    child: str,
    kind: str,
    xyz: Sequence[float] = (0, 0, 0),
    rpy: Sequence[float] = (0, 0, 0),
) -> None:
    joint = SubElement(robot, "joint", name=f"{parent}_to_{child}", type=kind)
    SubElement(joint, "origin", xyz=_numbers(xyz), rpy=_numbers(rpy))
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)


def _rpy(R: Array) -> tuple[float, float, float]:
    """URDF's fixed-axis roll, pitch and yaw of a rotation matrix, from its quaternion."""
    w, x, y, z = quaternions_of(R[None])[0].tolist()
    return (
        float(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))),
        float(np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))),
        float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))),
    )


def _numbers(values: Sequence[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _vector(text: str) -> tuple[float, float, float]:
    x, y, z = (float(word) for word in text.split())
    return (x, y, z)


def _colour(text: str) -> tuple[float, float, float, float]:
    red, green, blue, alpha = (float(word) for word in text.split())
    return (red, green, blue, alpha)
