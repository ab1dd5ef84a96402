"""A model's URDF, checked, with this stack's names of links and joints and with the model's limits in it."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from hal.limits import DOF, ArmLimits
from hal.robots.bodies import DescriptionError, check_joint, check_link, linked, numbers, parsed

LINKS = tuple(f"link{number}" for number in range(DOF + 2))  # base to last joint, flange
JOINTS = tuple(f"joint{number}" for number in range(1, DOF + 2))  # the last one is fixed: the flange's
LARGEST_NUMBER_OF_CAPSULES = 15  # of an arm; the safety judge has room for these and the pad
HEAVIEST_ARM_KG = 200.0  # ours: 1 kg in g is more, and no joint of such an arm holds it


def described(text: str, name: str, joints: tuple[str, ...], flange: str, limits: ArmLimits) -> str:
    """Return the URDF of the chain of `joints` and its flange's link as a text of its own. Raises DescriptionError.

    Kept: every link's inertia, collision and visual geometry. Limits are the model's, whatever the text has. Each joint
    has to turn about its z axis, the flange to be fixed to the last link, along its z.
    """
    source = parsed(text)
    by_child = {linked(joint, "child"): joint for joint in source.findall("joint")}
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
        check_joint(joint)
        if joint.get("type") not in ("revolute", "continuous"):
            raise DescriptionError(f"joint {joint_name!r}: type {joint.get('type')!r}, expected revolute")
        axis = numbers(joint.find("axis"), "axis", "xyz", joint_name)
        if axis != [0.0, 0.0, 1.0]:
            raise DescriptionError(f'joint {joint_name!r}: must turn about its z axis: axis xyz="0 0 1", found {axis}')
        if number > 0 and linked(joint, "parent") != parent:
            raise DescriptionError(f"joint {joint_name!r}: its parent is not {parent!r}, the child of the joint before")
        if number == 0:
            robot.append(_link(source, linked(joint, "parent"), LINKS[0], inertia=True))
        parent = linked(joint, "child")
        robot.append(_joint(joint, number, "revolute", limits))
        robot.append(_link(source, parent, LINKS[number + 1], inertia=True))
    if linked(fixed, "parent") != parent:
        raise DescriptionError(f"joint {fixed.get('name')!r}: its parent is not {parent!r}, the last joint's child")
    check_joint(fixed)
    robot.append(_joint(fixed, DOF, "fixed", None))
    rpy, xyz = (numbers(fixed.find("origin"), "origin", key, flange) for key in ("rpy", "xyz"))
    if rpy != [0.0] * 3 or xyz[:2] != [0.0, 0.0]:
        raise DescriptionError(f"joint {fixed.get('name')!r}: the flange must lie along the last joint's z, not turned")
    robot.append(_link(source, flange, LINKS[-1], inertia=False))
    weight = sum(float(mass.attrib["value"]) for mass in robot.findall("link/inertial/mass"))
    if weight > HEAVIEST_ARM_KG:
        raise DescriptionError(f"its links weigh {weight:g} kg, expected at most {HEAVIEST_ARM_KG:g} (kg; not g)")
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
    check_link(found)
    mass = found.find("inertial/mass")
    if inertia and (mass is None or float(mass.attrib["value"]) == 0.0):
        raise DescriptionError(f"link {name!r}: has no inertial with mass and inertia")
    link = Element("link", name=new)
    link.extend(found)
    return link
