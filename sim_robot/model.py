"""The MuJoCo model of the cell, generated in memory from the arms' description and the scene.

Degrees of freedom: seven joints of each arm, in the order of `Scene.sides`, then the object's free joint: with two arms
0-6, 7-13 and 14-19 (qpos 14-20). MuJoCo sees the link side of the arms only: no armature, no joint damping, no
actuators, no joint limits (the reflexes watch those).
"""

from dataclasses import dataclass
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np

from hal.base.arrays import Array
from sim_robot.arm_description import JOINTS, ArmDescription
from sim_robot.contact import set_contacts
from sim_robot.hand_parameters import FINGER_SIZE, PALM_SIZE, TURN_RAD, FrankaHand
from sim_robot.scene import ArmPlacement, GraspObject, ObjectPlacement, Platform, Scene

SUBSTEPS = 4
TIMESTEP_S = 0.25e-3  # the vendor's torque loop runs at 4 kHz
GRAVITY = 9.81
PROXIMITY_M = 5e-3  # links that come this near are seen before they touch

# what the model has none of, and MuJoCo would go through in each step
_NOT_THERE = ("equality", "frictionloss", "limit", "spring", "damper", "actuation", "sensor")

# collision masks: an arm meets the other arm, the table and the object, never itself
_LEFT, _RIGHT, _OBJECT, _TABLE = 1, 2, 4, 8
_MASKS = {
    "left": (_LEFT, _RIGHT),
    "right": (_RIGHT, _LEFT),
    "object": (_OBJECT, _LEFT | _RIGHT),
    "table": (_TABLE, _LEFT | _RIGHT | _OBJECT),
}


@dataclass(frozen=True, slots=True)
class CellModel:
    """The compiled model and where things are in it. Body indices (n,) are in the order of `Scene.sides`.

    pad_bodies: what is on the flange, a pad or a hand; finger_bodies: two of each hand.
    """

    model: mujoco.MjModel
    pad_bodies: tuple[int, ...]
    finger_bodies: tuple[tuple[int, ...], ...]
    link1_bodies: tuple[int, ...]
    object_body: int


def _text(values: object) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values, dtype=float).ravel())


def _quaternion(R: Array) -> Array:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(R).ravel())
    return quaternion


def _collides(geom: Element, what: str) -> None:
    contype, conaffinity = _MASKS[what]
    geom.set("contype", str(contype))
    geom.set("conaffinity", str(conaffinity))


def _add_arm(
    world: Element, side: str, place: ArmPlacement, arm: ArmDescription, scene: Scene, friction: float
) -> None:
    body = SubElement(world, "body", name=f"{side}_link0", pos=_text(place.T_world_base_position))
    body.set("quat", _text(place.T_world_base_wxyz))
    for index, link in enumerate(arm.links):
        if index > 0:
            T = arm.T_parent_joint[index - 1]
            body = SubElement(body, "body", name=f"{side}_{link.name}", pos=_text(T[:3, 3]))
            body.set("quat", _text(_quaternion(T[:3, :3])))
            SubElement(body, "joint", name=f"{side}_joint{index}", type="hinge", axis="0 0 1")
        I = link.inertia  # noqa: E741 - the field's name
        inertial = SubElement(body, "inertial", pos=_text(link.centre), mass=_text(link.mass))
        inertial.set("fullinertia", _text((I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])))
        for number, capsule in enumerate(link.capsules):
            T = capsule.T_link_capsule
            geom = SubElement(body, "geom", name=f"{side}_{link.name}_{number}", type="capsule", pos=_text(T[:3, 3]))
            geom.set("quat", _text(_quaternion(T[:3, :3])))
            geom.set("size", _text((capsule.radius, capsule.half_length)))
            # within the gap a contact is seen and exerts nothing
            geom.set("margin", repr(PROXIMITY_M))
            geom.set("gap", repr(PROXIMITY_M))
            _collides(geom, side)
    if place.hand is not None:
        _add_hand(body, side, place.hand, arm.flange_offset_z)
        return
    pad = place.pad or scene.pad
    T = pad.F_T_box
    middle = (0.0, 0.0, arm.flange_offset_z) + pad.F_T_face[:3, 3] - T[:3, 2] * (pad.size[2] / 2.0)
    body = SubElement(body, "body", name=f"{side}_pad", pos=_text(middle))
    if pad.orientation_wxyz[1:] != (0.0, 0.0, 0.0):
        body.set("quat", _text(_quaternion(T[:3, :3])))
    geom = SubElement(body, "geom", name=f"{side}_pad", type="box", size=_text(np.array(pad.size) / 2.0))
    if pad.centre is None and pad.inertia is None:
        geom.set("mass", repr(pad.mass))
    else:
        geom.set("mass", "0")
        I = T[:3, :3].T @ pad.I_centre @ T[:3, :3]  # noqa: E741 - the field's name
        inertial = SubElement(
            body, "inertial", pos=_text(T[:3, :3].T @ (pad.F_x_centre - T[:3, 3])), mass=repr(pad.mass)
        )
        inertial.set("fullinertia", _text((I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])))
    geom.set("friction", f"{friction!r} 0 0")
    geom.set("priority", "1")  # the pad's friction and stiffness count, not the larger of the two
    _collides(geom, side)


def _add_hand(link7: Element, side: str, hand: FrankaHand, flange_offset_z: float) -> None:
    """Put a hand on the flange: its body has the flange's frame, its fingers are bodies without joints."""
    body = SubElement(link7, "body", name=f"{side}_hand", pos=_text((0.0, 0.0, flange_offset_z)))
    inertial = SubElement(body, "inertial", pos=_text(hand.centre), mass=repr(hand.mass))
    inertial.set("diaginertia", _text(hand.inertia))
    turn = _text((np.cos(TURN_RAD / 2.0), 0.0, 0.0, np.sin(TURN_RAD / 2.0)))
    palm = SubElement(body, "geom", name=f"{side}_palm", type="box", quat=turn, size=_text(np.array(PALM_SIZE) / 2.0))
    palm.set("pos", _text((0.0, 0.0, PALM_SIZE[2] / 2.0)))
    _collides(palm, side)
    for number in range(2):
        finger = SubElement(body, "body", name=f"{side}_finger{number + 1}", quat=turn)
        finger.set("pos", _text(hand.finger_position(number, hand.start_width)))
        geom = SubElement(finger, "geom", name=f"{side}_finger{number + 1}", type="box", mass="0")
        geom.set("size", _text(np.array(FINGER_SIZE) / 2.0))
        geom.set("friction", f"{hand.friction!r} 0 0")
        geom.set("priority", "1")
        _collides(geom, side)


def cell_xml(scene: Scene, object_name: str, placement: ObjectPlacement, arms: tuple[ArmDescription, ...]) -> str:
    """Return the MJCF of the cell with this object. `arms`: the drawn descriptions (n,)."""
    thing, table = scene.find(object_name), scene.table
    pad_friction, table_friction = scene.frictions(object_name)
    root = Element("mujoco", model=scene.name)
    SubElement(root, "compiler", angle="radian", autolimits="false")
    option = SubElement(root, "option", timestep=repr(TIMESTEP_S), integrator="implicitfast", cone="elliptic")
    option.set("gravity", f"0 0 {-GRAVITY}")
    option.set("impratio", repr(scene.contact.friction_ratio))
    option.set("jacobian", "dense")  # MuJoCo 4.0.0's Newton solver has a wrong Hessian for sparse ones (mujoco#3767)
    # a simulation that diverges must stop, not start again in silence; islands cost more than they save here
    flags: dict[str, str] = dict.fromkeys(("autoreset", "island", *_NOT_THERE), "disable")
    SubElement(option, "flag", flags)
    world = SubElement(root, "worldbody")
    for side, place, arm in zip(scene.sides, scene.arms, arms, strict=True):
        _add_arm(world, side, place, arm, scene, pad_friction)
    geom = SubElement(world, "geom", name="table", type="box", pos=_text((*table.centre_xy, table.top_z / 2.0)))
    geom.set("size", _text((table.size_xy[0] / 2.0, table.size_xy[1] / 2.0, table.top_z / 2.0)))
    geom.set("friction", f"{table_friction!r} 0 0")
    _collides(geom, "table")
    if scene.platform is not None:
        _add_platform(world, scene.platform)
    if placement.on_wedge:
        _add_wedge(world, table_friction, thing, placement)
    body = SubElement(world, "body", name="object", pos=_text(placement.position), quat=_text(placement.wxyz))
    SubElement(body, "freejoint", name="object")
    geom = SubElement(body, "geom", name="object", type="box", size=_text(np.array(thing.size) / 2.0))
    geom.set("mass", repr(thing.mass))
    geom.set("friction", f"{table_friction!r} 0 0")
    _collides(geom, "object")
    return ElementTree.tostring(root, encoding="unicode")


def _add_platform(world: Element, platform: Platform) -> None:
    half = np.array(platform.size) / 2.0
    angle = -np.radians(platform.inclination_deg)  # about y, which would turn x down
    down = half[2] * np.array([np.sin(angle), 0.0, np.cos(angle)])
    geom = SubElement(world, "geom", name="platform", type="box", pos=_text(np.array(platform.centre) - down))
    geom.set("size", _text(half))
    geom.set("quat", _text((np.cos(angle / 2.0), 0.0, np.sin(angle / 2.0), 0.0)))
    _collides(geom, "table")


def _add_wedge(world: Element, friction: float, thing: GraspObject, placement: ObjectPlacement) -> None:
    """Put a wedge under a tilted object: two thirds of its underside, from the edge on the table upwards."""
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, np.array(placement.wxyz))
    R = R.reshape(3, 3)
    half = np.array(thing.size) / 2.0
    low = -1.0 if R[2, 1] > 0.0 else 1.0  # which of the object's sides, along its y, is the lower one
    size = half * (1.0, 2.0 / 3.0, 0.3)
    centre = np.array(placement.position) + R @ (0.0, low * half[1] / 3.0, -half[2] - size[2])
    geom = SubElement(world, "geom", name="wedge", type="box", pos=_text(centre), size=_text(size))
    geom.set("quat", _text(placement.wxyz))
    geom.set("friction", f"{friction!r} 0 0")
    _collides(geom, "table")


def build_cell(
    scene: Scene, object_name: str, placement: ObjectPlacement, arms: tuple[ArmDescription, ...],
    stiffness: tuple[float | None, ...],
) -> CellModel:  # fmt: skip
    """Compile the cell, with its contacts set. stiffness: see set_contacts. Raises UnknownObject."""
    model = mujoco.MjModel.from_xml_string(cell_xml(scene, object_name, placement, arms))
    if model.nv != JOINTS * len(arms) + 6:
        raise ValueError(f"the cell has {model.nv} degrees of freedom, expected {JOINTS * len(arms) + 6}")
    set_contacts(model, scene, scene.find(object_name), stiffness)

    with_hands = [(side, place.hand is not None) for side, place in zip(scene.sides, scene.arms, strict=True)]
    ends = tuple(model.body(f"{side}_{'hand' if hand else 'pad'}").id for side, hand in with_hands)
    fingers = tuple(
        tuple(model.body(f"{side}_finger{number}").id for number in (1, 2) if hand) for side, hand in with_hands
    )
    link1_bodies = tuple(model.body(f"{side}_link1").id for side in scene.sides)
    return CellModel(model, ends, fingers, link1_bodies, model.body("object").id)
