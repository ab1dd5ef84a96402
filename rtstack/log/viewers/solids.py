"""The solids that viewers draw, in the frames of /tf: both arms as their URDFs have them, pads, table and object."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, replace
from functools import lru_cache
from xml.etree.ElementTree import Element

from rtstack.log.viewers.frames import OBJECT, TABLE, CellFrames, triple

# red, green, blue, alpha: what is squeezed lets the forces be seen
COLOURS: dict[str, tuple[float, float, float, float]] = {
    "arm": (0.88, 0.89, 0.91, 1.0), "pad": (0.16, 0.17, 0.19, 1.0),
    "table": (0.55, 0.50, 0.44, 1.0), "object": (0.85, 0.65, 0.25, 0.45),
}  # fmt: skip
_NONE = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Shape:
    """A solid of a link: box (x, y, z), cylinder (diameter, diameter, length) or sphere (diameter, ...), m."""

    link: str
    kind: str
    position: tuple[float, float, float]
    rpy: tuple[float, float, float]
    size: tuple[float, float, float]
    colour: tuple[float, float, float, float]


@lru_cache(maxsize=8)  # a campaign's logs are of a few cells
def shapes_of(cell: CellFrames) -> list[Shape]:
    """Return the solids of a cell with its arms. Things without a size are left out."""
    shapes = []
    for side in cell.sides:
        shapes += [replace(each, link=f"{side}_{each.link}") for each in shapes_in(cell.urdf[side])]
        x, y, z = cell.pad_size_m[side]
        # the frame is in the pad's outer face
        shapes.append(Shape(f"{side}_pad", "box", (0.0, 0.0, -0.5 * z), _NONE, (x, y, z), COLOURS["pad"]))
    shapes.append(Shape(TABLE, "box", _NONE, _NONE, cell.table_size_m, COLOURS["table"]))
    shapes.append(Shape(OBJECT, "box", _NONE, _NONE, cell.object_size_m, COLOURS["object"]))
    return [shape for shape in shapes if any(shape.size)]


def shapes_in(urdf: str) -> list[Shape]:
    shapes = []
    for link in ElementTree.fromstring(urdf).findall("link"):
        for visual in link.findall("visual"):
            origin, geometry = visual.find("origin"), visual.find("geometry")
            place = {} if origin is None else origin.attrib
            xyz, rpy = triple(place.get("xyz", "0 0 0")), triple(place.get("rpy", "0 0 0"))
            for solid in () if geometry is None else geometry:
                shapes.append(Shape(link.attrib["name"], solid.tag, xyz, rpy, _size(solid), COLOURS["arm"]))
    return shapes


def _size(solid: Element) -> tuple[float, float, float]:
    if solid.tag == "box":
        return triple(solid.attrib["size"])
    width = 2.0 * float(solid.attrib["radius"])
    return (width, width, float(solid.get("length", width)))
