"""The tree of a URDF, and the numbers of its links and joints: refused where no body and no joint can have them.

The bounds catch another unit (mm, g, degrees) and are ours: no part of a laboratory's arm comes near them.
"""

import math
import re
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from hal.base.configuration import shortened
from hal.pad import of_a_body

FAR_M, HEAVY_KG, TURN_RAD = 10.0, 1000.0, 6.2832  # 2 pi, rounded up as people write it
_GYRATION_M = (1e-5, FAR_M)  # radii of gyration, sqrt(I / m): g mm^2 and kg mm^2 are outside
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_ONCE = ("inertial", "origin", "mass", "inertia", "geometry", "parent", "child", "axis", "limit")
_SHAPES = ("box", "cylinder", "sphere", "capsule", "mesh")
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


class DescriptionError(ValueError):
    """A URDF that cannot be used. The message names the link or joint."""


class _Rule(NamedTuple):
    """How many numbers an attribute has, which, and what it is where it is not there (None: it has to be)."""

    how_many: int
    accepts: Callable[[float], bool]
    expected: str
    default: str | None = None


_SIZE = _Rule(1, lambda x: 0.0 < x <= FAR_M, f"a number above 0, at most {FAR_M:g} (m; not mm)")
_ANY = _Rule(1, lambda _: True, "a finite number")
_POSITIVE = _Rule(1, lambda x: x > 0.0, "a number above 0")
_NOT_NEGATIVE = _Rule(1, lambda x: x >= 0.0, "a number from 0 on", "0")
_RULES: dict[str, dict[str, _Rule]] = {
    "origin": {
        "xyz": _Rule(3, lambda x: abs(x) <= FAR_M, f"three numbers up to {FAR_M:g} (m; not mm)", "0 0 0"),
        "rpy": _Rule(3, lambda x: abs(x) <= TURN_RAD, "three numbers up to 2 pi (rad; not degrees)", "0 0 0"),
    },
    "mass": {"value": _Rule(1, lambda x: 0.0 <= x <= HEAVY_KG, f"a number above 0, at most {HEAVY_KG:g} (kg; not g)")},
    "inertia": dict.fromkeys(_MOMENTS, _ANY),
    "cylinder": {"radius": _SIZE, "length": _SIZE},
    "capsule": {"radius": _SIZE, "length": _SIZE},
    "sphere": {"radius": _SIZE},
    "box": {"size": _SIZE._replace(how_many=3, expected=f"three numbers above 0, at most {FAR_M:g} (m; not mm)")},
    "mesh": {"scale": _Rule(3, lambda x: x != 0.0, "three numbers, none of them 0", "1 1 1")},
    "color": {"rgba": _Rule(4, lambda x: 0.0 <= x <= 1.0, "four numbers from 0 to 1")},
    "axis": {"xyz": _Rule(3, lambda _: True, "three finite numbers", "1 0 0")},
    "dynamics": {"damping": _NOT_NEGATIVE, "friction": _NOT_NEGATIVE},
    "limit": {
        "lower": _ANY._replace(default="0"),
        "upper": _ANY._replace(default="0"),
        "velocity": _POSITIVE,
        "effort": _POSITIVE,
    },
}


class _Builder(ElementTree.TreeBuilder):
    def doctype(self, *_: object) -> None:
        raise DescriptionError("has a DOCTYPE; a robot's description needs none: remove it and its entities")


def parsed(text: str) -> Element:
    """Return the root of a URDF whose names are unique and whose joints connect its links to one tree. Raises
    DescriptionError."""
    try:
        source = ElementTree.fromstring(text, ElementTree.XMLParser(target=_Builder()))
    except ElementTree.ParseError as error:
        raise DescriptionError(f"not valid XML: {error}") from None
    parts = [part for part in source if part.tag in ("link", "joint")]
    for part, number in Counter((part.tag, part.get("name", "")) for part in parts).items():
        if number > 1 or not part[1]:
            raise DescriptionError(f"{part[0]} {shortened(part[1])!r}: {number} have this name, expected one")
    _check_tree(source)
    return source


def numbers(element: Element | None, tag: str, attribute: str, where: str) -> list[float]:
    """Return an attribute's numbers; those of the URDF's default, where the element or the attribute is not there.
    Raises DescriptionError."""
    rule = _RULES[tag][attribute]
    text = rule.default if element is None else element.get(attribute, rule.default)
    if text is None:
        raise DescriptionError(f"{where}: {tag} has no {attribute}, expected {rule.expected}")
    found = [float(word) for word in text.split() if _NUMBER.fullmatch(word)]
    if not len(found) == len(text.split()) == rule.how_many or not all(
        math.isfinite(x) and rule.accepts(x) for x in found
    ):
        raise DescriptionError(f"{where}: {tag} {attribute}={shortened(text)!r}, expected {rule.expected}")
    return found


def _check_numbers(part: Element, where: str) -> None:
    """Check the numbers of a link or joint, and that it has each part once."""
    for element in part.iter():
        for attribute in _RULES.get(element.tag, ()):
            numbers(element, element.tag, attribute, where)
        twice = [tag for tag, number in Counter(child.tag for child in element).items() if number > 1 and tag in _ONCE]
        if twice:
            raise DescriptionError(f"{where}: {element.tag} has more than one {twice[0]}, expected one")
        shapes = [shape.tag for shape in element.findall("geometry/*") if shape.tag in _SHAPES]
        if element.tag in ("visual", "collision") and len(shapes) != 1:
            raise DescriptionError(
                f"{where}: {element.tag} has no shape or several, expected one of {', '.join(_SHAPES)}"
            )


def check_link(link: Element) -> None:
    """Raise DescriptionError for a link that is no body: its mass, inertia and geometry. A frame may have no mass."""
    where = f"link {shortened(link.get('name', ''))!r}"
    _check_numbers(link, where)
    inertial = link.find("inertial")
    if inertial is None:
        return
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        raise DescriptionError(f"{where}: has no inertial with mass and inertia")
    (kg,) = numbers(mass, "mass", "value", where)
    xx, yy, zz, xy, xz, yz = moments = tuple(numbers(inertia, "inertia", key, where)[0] for key in _MOMENTS)
    if kg == 0.0:
        if link.find("collision") is not None or link.find("visual") is not None or any(moments):
            raise DescriptionError(f"{where}: mass value='0', expected a number above 0: it has geometry or inertia")
        return
    try:
        of_a_body((xx, yy, zz, xy, xz, yz))
    except ValueError as error:
        raise DescriptionError(f"{where}: inertia {dict(zip(_MOMENTS, moments, strict=True))}: {error}") from None
    for moment in (xx, yy, zz):
        if not _GYRATION_M[0] <= math.sqrt(moment / kg) <= _GYRATION_M[1]:
            raise DescriptionError(
                f"{where}: a moment of {moment:g} kg m^2 with a mass of {kg:g} kg is a radius of gyration of "
                f"{math.sqrt(moment / kg):.3g} m, expected {_GYRATION_M[0]:g} to {_GYRATION_M[1]:g}: another unit?"
            )


def check_joint(joint: Element) -> None:
    """Raise DescriptionError for a joint whose origin, axis or limits cannot be."""
    where = f"joint {shortened(joint.get('name', ''))!r}"
    _check_numbers(joint, where)
    limit = joint.find("limit")
    if limit is None or joint.get("type") != "revolute":
        return
    lower, upper = (numbers(limit, "limit", key, where)[0] for key in ("lower", "upper"))
    if not -TURN_RAD <= lower < upper <= TURN_RAD:
        raise DescriptionError(
            f"{where}: limit lower={lower:g} upper={upper:g}, expected lower below upper, both up to 2 pi (rad; not "
            "degrees)"
        )


def _check_tree(source: Element) -> None:
    links, children = {link.get("name", "") for link in source.findall("link")}, dict[str, list[str]]()
    roots = set(links)
    for joint in source.findall("joint"):
        where, (parent, child) = f"joint {joint.get('name')!r}", (linked(joint, which) for which in ("parent", "child"))
        if joint.get("type") not in _TYPES:
            raise DescriptionError(f"{where}: type {joint.get('type')!r}, expected one of {', '.join(_TYPES)}")
        if missing := {parent, child} - links:
            raise DescriptionError(f"{where}: no link {missing.pop()!r}")
        if child not in roots:
            raise DescriptionError(f"{where}: link {child!r} is the child of two joints, expected one")
        roots.remove(child)
        children.setdefault(parent, []).append(child)
    if len(roots) > 1:
        raise DescriptionError(
            f"links {' and '.join(map(repr, sorted(roots)[:2]))}: no joint connects them to one tree"
        )
    reached = list(roots)
    for name in reached:
        reached += children.get(name, [])
    if loop := links - set(reached):
        raise DescriptionError(f"link {min(loop)!r}: the joints make a loop, expected a tree")


def linked(joint: Element, which: str) -> str:
    """Return the link that a joint has as its parent or child. Raises DescriptionError."""
    element = joint.find(which)
    if element is None or not element.get("link"):
        raise DescriptionError(f"joint {joint.get('name')!r}: has no {which}")
    return element.attrib["link"]
