"""The tree of a URDF, and the numbers of its links and joints: refused where no body and no joint can have them.

The bounds catch another unit (mm, g, degrees) and are ours: no part of a laboratory's arm comes near them.
"""

import math
import re
from collections import Counter
from graphlib import CycleError, TopologicalSorter
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from hal.base.configuration import shortened
from hal.pad import of_a_body

FAR_M, HEAVY_KG, TURN_RAD = 10.0, 1000.0, 6.2832  # 2 pi, rounded up as people write it
_LEAST_M = 1e-5  # radii of gyration, sqrt(I / m), are between it and FAR_M: g mm^2 and kg mm^2 are outside
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_ONCE = ("inertial", "origin", "mass", "inertia", "geometry", "parent", "child", "axis", "limit")
_SHAPES = ("box", "cylinder", "sphere", "capsule", "mesh")
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


class DescriptionError(ValueError):
    """A URDF that cannot be used. The message names the link or joint."""


_LONG = f"above 0, at most {FAR_M:g} (m; not mm)"
_SIZE = (1, lambda x: 0.0 < x <= FAR_M, f"a number {_LONG}", None)
_ANY = (1, lambda x: True, "a finite number", None)
_POSITIVE = (1, lambda x: x > 0.0, "a number above 0", None)
_NOT_NEGATIVE = (1, lambda x: x >= 0.0, "a number from 0 on", "0")
# Each attribute has: the count of its numbers, a check, the check in words, and a default (None: it is required).
_RULES = {
    ("origin", "xyz"): (3, lambda x: abs(x) <= FAR_M, f"three numbers up to {FAR_M:g} (m; not mm)", "0 0 0"),
    ("origin", "rpy"): (3, lambda x: abs(x) <= TURN_RAD, "three numbers up to 2 pi (rad; not degrees)", "0 0 0"),
    ("mass", "value"): (1, lambda x: 0.0 <= x <= HEAVY_KG, f"above 0, at most {HEAVY_KG:g} (kg; not g)", None),
    **dict.fromkeys((("inertia", moment) for moment in _MOMENTS), _ANY),
    **dict.fromkeys((("cylinder", "radius"), ("cylinder", "length"), ("sphere", "radius")), _SIZE),
    **dict.fromkeys((("capsule", "radius"), ("capsule", "length")), _SIZE),
    ("box", "size"): (3, lambda x: 0.0 < x <= FAR_M, f"three numbers {_LONG}", None),
    ("mesh", "scale"): (3, lambda x: x != 0.0, "three numbers, none of them 0", "1 1 1"),
    ("color", "rgba"): (4, lambda x: 0.0 <= x <= 1.0, "four numbers from 0 to 1", None),
    ("axis", "xyz"): (3, lambda x: True, "three finite numbers", "1 0 0"),
    **dict.fromkeys((("dynamics", "damping"), ("dynamics", "friction")), _NOT_NEGATIVE),
    **dict.fromkeys((("limit", "lower"), ("limit", "upper")), (*_ANY[:3], "0")),
    **dict.fromkeys((("limit", "velocity"), ("limit", "effort")), _POSITIVE),
}


class _Builder(ElementTree.TreeBuilder):
    def doctype(self, *_: object) -> None:
        raise DescriptionError("has a DOCTYPE; a robot's description needs none: remove it and its entities")


def parsed(text: str) -> Element:
    """Return the root of a URDF whose names are unique, whose links are bodies or frames, and whose joints connect them
    to one tree. Raises DescriptionError."""
    try:
        source = ElementTree.fromstring(text, ElementTree.XMLParser(target=_Builder()))
    except ElementTree.ParseError as error:
        raise DescriptionError(f"not valid XML: {error}") from None
    parts = [part for part in source if part.tag in ("link", "joint")]
    for part, number in Counter((part.tag, part.get("name", "")) for part in parts).items():
        if number > 1 or not part[1]:
            raise DescriptionError(f"{part[0]} {shortened(part[1])!r}: {number} have this name, expected one")
    links, parents = {link.get("name", ""): check_link(link) for link in source.findall("link")}, dict[str, str]()
    for joint in source.findall("joint"):
        where, (parent, child) = f"joint {joint.get('name')!r}", (linked(joint, which) for which in ("parent", "child"))
        if joint.get("type") not in _TYPES:
            raise DescriptionError(f"{where}: type {joint.get('type')!r}, expected one of {', '.join(_TYPES)}")
        if missing := {parent, child} - links.keys():
            raise DescriptionError(f"{where}: no link {missing.pop()!r}")
        if child in parents:
            raise DescriptionError(f"{where}: link {child!r} is the child of two joints, expected one")
        parents[child] = parent
    if len(roots := sorted(links.keys() - parents)) > 1:
        raise DescriptionError(f"links {' and '.join(map(repr, roots[:2]))}: no joint connects them to one tree")
    try:
        TopologicalSorter({child: [parent] for child, parent in parents.items()}).prepare()
    except CycleError as error:
        raise DescriptionError(f"link {min(error.args[1])!r}: the joints make a loop, expected a tree") from None
    return source


def numbers(element: Element | None, tag: str, attribute: str, where: str) -> list[float]:
    """Return an attribute's numbers, or the URDF's default where it is not there. Raises DescriptionError."""
    how_many, accepts, expected, default = _RULES[tag, attribute]
    text = default if element is None else element.get(attribute, default)
    if text is None:
        raise DescriptionError(f"{where}: {tag} has no {attribute}, expected {expected}")
    found = [float(word) if _NUMBER.fullmatch(word) else math.nan for word in text.split()]
    if len(found) != how_many or not all(math.isfinite(x) and accepts(x) for x in found):
        raise DescriptionError(f"{where}: {tag} {attribute}={shortened(text)!r}, expected {expected}")
    return found


def _check_numbers(part: Element) -> str:
    """Check the numbers of a link or joint, and that it has each part once. Returns its name for messages."""
    where = f"{part.tag} {shortened(part.get('name', ''))!r}"
    for element in part.iter():
        for tag, attribute in _RULES:
            if tag == element.tag:
                numbers(element, tag, attribute, where)
        for tag, number in Counter(child.tag for child in element).items():
            if number > 1 and tag in _ONCE:
                raise DescriptionError(f"{where}: {element.tag} has more than one {tag}, expected one")
        shapes = [shape for shape in element.findall("geometry/*") if shape.tag in _SHAPES]
        if element.tag in ("visual", "collision") and len(shapes) != 1:
            raise DescriptionError(f"{where}: {element.tag} has no shape or several, expected a {', '.join(_SHAPES)}")
    return where


def check_link(link: Element) -> None:
    """Raise DescriptionError for a link that is no body: its mass, inertia and geometry. A frame may have no mass."""
    where, inertial = _check_numbers(link), link.find("inertial")
    if inertial is None:
        return
    (kg,) = numbers(inertial.find("mass"), "mass", "value", where)
    inertia = inertial.find("inertia")
    xx, yy, zz, xy, xz, yz = (numbers(inertia, "inertia", key, where)[0] for key in _MOMENTS)
    if kg == 0.0:
        if link.find("collision") is not None or link.find("visual") is not None or any((xx, yy, zz, xy, xz, yz)):
            raise DescriptionError(f"{where}: mass value='0', expected a number above 0: it has geometry or inertia")
        return
    try:
        of_a_body((xx, yy, zz, xy, xz, yz))
    except ValueError as error:
        raise DescriptionError(f"{where}: inertia: {error}") from None
    for moment in (xx, yy, zz):
        if not _LEAST_M <= (radius := math.sqrt(moment / kg)) <= FAR_M:
            raise DescriptionError(
                f"{where}: a moment of {moment:g} kg m^2 and a mass of {kg:g} kg make a radius of gyration of "
                f"{radius:.3g} m, expected {_LEAST_M:g} to {FAR_M:g}: another unit?"
            )


def check_joint(joint: Element) -> None:
    """Raise DescriptionError for a joint whose origin, axis or limits cannot be."""
    where, limit = _check_numbers(joint), joint.find("limit")
    if limit is not None and joint.get("type") == "revolute":
        lower, upper = (numbers(limit, "limit", key, where)[0] for key in ("lower", "upper"))
        if not -TURN_RAD <= lower < upper <= TURN_RAD:
            found = f"limit lower={lower:g} upper={upper:g}"
            raise DescriptionError(f"{where}: {found}, expected lower below upper, both up to 2 pi (rad; not degrees)")


def linked(joint: Element, which: str) -> str:
    """Return the link that a joint has as its parent or child. Raises DescriptionError."""
    element = joint.find(which)
    if element is None or not element.get("link"):
        raise DescriptionError(f"joint {joint.get('name')!r}: has no {which}")
    return element.attrib["link"]
