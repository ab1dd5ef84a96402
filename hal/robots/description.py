"""A model's URDF, checked, with this stack's names of links and joints and with the model's limits in it."""

import math
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from hal.limits import DOF, ArmLimits

LINKS = tuple(f"link{number}" for number in range(DOF + 2))  # base to last joint, flange
JOINTS = tuple(f"joint{number}" for number in range(1, DOF + 2))  # the last one is fixed: the flange's
LARGEST_NUMBER_OF_CAPSULES = 15  # of an arm; the safety judge has room for these and the pad


class DescriptionError(ValueError):
    """A URDF that cannot be used. The message names the link or joint."""


def described(text: str, name: str, joints: tuple[str, ...], flange: str, limits: ArmLimits) -> str:
    """Return the URDF of the chain of `joints` and its flange's link as a text of its own. Raises DescriptionError.

    Kept: every link's inertia, collision and visual geometry. Limits are the model's, whatever the text has. Each joint
    has to turn about its z axis, the flange to be fixed to the last link, along its z.
    """
    try:
        source = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise DescriptionError(f"not valid XML: {error}") from None
    by_child = {_named(joint, "child"): joint for joint in source.findall("joint")}
    by_name = {joint.get("name"): joint for joint in source.findall("joint")}
    fixed = by_child.get(flange)
    if fixed is None or fixed.get("type") != "fixed":
        raise DescriptionError(f"no fixed joint has the child link {flange!r}, the flange")
    robot = Element("robot", name=name)
    parent = ""
    for number, joint_name in enumerate(joints):
        joint = by_name.get(joint_name)
        if joint is None:
            raise DescriptionError(f"no joint {joint_name!r}")
        if joint.get("type") not in ("revolute", "continuous"):
            raise DescriptionError(f"joint {joint_name!r}: type {joint.get('type')!r}, expected revolute")
        axis = joint.find("axis")
        if axis is None or _numbers(axis.get("xyz", "1 0 0"), joint_name) != [0.0, 0.0, 1.0]:
            raise DescriptionError(f'joint {joint_name!r}: must turn about its z axis: axis xyz="0 0 1"')
        if number > 0 and _named(joint, "parent") != parent:
            raise DescriptionError(f"joint {joint_name!r}: its parent is not {parent!r}, the child of the joint before")
        if number == 0:
            robot.append(_link(source, _named(joint, "parent"), LINKS[0], inertia=True))
        parent = _named(joint, "child")
        robot.append(_joint(joint, number, "revolute", limits))
        robot.append(_link(source, parent, LINKS[number + 1], inertia=True))
    if _named(fixed, "parent") != parent:
        raise DescriptionError(f"joint {fixed.get('name')!r}: its parent is not {parent!r}, the last joint's child")
    robot.append(_joint(fixed, DOF, "fixed", None))
    origin = robot[-1].find("origin")
    rpy, xyz = ("", "") if origin is None else (origin.get("rpy", "0 0 0"), origin.get("xyz", "0 0 0"))
    if origin is None or _numbers(rpy, flange) != [0.0] * 3 or _numbers(xyz, "origin")[:2] != [0.0, 0.0]:
        raise DescriptionError(f"joint {fixed.get('name')!r}: the flange must lie along the last joint's z, not turned")
    robot.append(_link(source, flange, LINKS[-1], inertia=False))
    capsules = len(robot.findall("link/collision/geometry/cylinder"))
    if not 0 < capsules <= LARGEST_NUMBER_OF_CAPSULES:
        raise DescriptionError(
            f"{capsules} collision cylinders, expected 1 to {LARGEST_NUMBER_OF_CAPSULES}: each stands for a capsule"
        )
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode")


def _joint(source: Element, number: int, kind: str, limits: ArmLimits | None) -> Element:
    joint = Element("joint", name=JOINTS[number], type=kind)
    joint.append(Element("parent", link=LINKS[number]))
    joint.append(Element("child", link=LINKS[number + 1]))
    origin = source.find("origin")
    joint.append(origin if origin is not None else Element("origin", xyz="0 0 0", rpy="0 0 0"))
    if limits is not None:
        joint.append(Element("axis", xyz="0 0 1"))
        values = {"lower": limits.q_lower, "upper": limits.q_upper, "velocity": limits.dq_max, "effort": limits.tau_max}
        joint.append(Element("limit", {key: repr(float(array[number])) for key, array in values.items()}))
        offset, deceleration = limits.enforced_velocity_law()  # libfranka refuses an arm without them
        law = {"velocity_offset": offset, "deceleration_limit": deceleration}
        law = {key: repr(float(array[number])) for key, array in law.items()}
        joint.append(Element("position_based_velocity_limits", law))
    return joint


def _link(source: Element, name: str, new: str, *, inertia: bool) -> Element:
    found = source.find(f"link[@name='{name}']")
    if found is None:
        raise DescriptionError(f"no link {name!r}")
    if inertia and (found.find("inertial/mass") is None or found.find("inertial/inertia") is None):
        raise DescriptionError(f"link {name!r}: has no inertial with mass and inertia")
    link = Element("link", name=new)
    link.extend(found)
    return link


def _named(joint: Element, which: str) -> str:
    element = joint.find(which)
    if element is None or not element.get("link"):
        raise DescriptionError(f"joint {joint.get('name')!r}: has no {which}")
    return element.attrib["link"]


def _numbers(text: str, where: str) -> list[float]:
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        raise DescriptionError(f"{where!r}: expected three finite numbers, got {text!r}")
    return numbers
