"""The MuJoCo model of the cell, generated in memory from the arms' description and the scene.

Degrees of freedom: seven joints of each arm in the order of `Scene.sides`, then the object's free joint. MuJoCo sees
the link side of the arms only: no armature, damping, actuators or joint limits (the reflexes watch those).
"""

from math import sqrt
from typing import Any

import mujoco
import numpy as np

from hal.base.arrays import Array
from sim_robot.arm_description import JOINTS, ArmDescription
from sim_robot.hand_parameters import FINGER_SIZE, PALM_SIZE, TURN_RAD, FrankaHand
from sim_robot.plant_parameters import Vector3
from sim_robot.scene import ArmPlacement, GraspObject, ObjectPlacement, Platform, Scene

POINTS_PER_FACE = 4.0
"""Contact points of a pad's face: the stiffness of a contact is divided among them."""


def series(stiffness: float, other: float) -> float:
    """Stiffness of two springs in series, N/m."""
    return 1.0 / (1.0 / stiffness + 1.0 / other)


def set_contacts(model: mujoco.MjModel, scene: Scene, thing: GraspObject, known: tuple[float | None, ...]) -> None:
    """Set solref and solimp of every geom: pads (or fingers) on the object or on the platform, the object
    on the table, hard links. known: the stiffness of a pad on the object, N/m, where it was identified, of each arm.

    The damping on an object is 2 zeta sqrt(K m), m the object's mass: the ratio of the object alone on that face.
    """

    def damping(stiffness: float) -> float:
        return 2.0 * thing.damping_ratio * sqrt(stiffness * thing.mass)

    weights = model.body_invweight0[:, 0]
    w_object = weights[model.body("object").id]
    on_table = series(thing.stiffness, scene.table.stiffness)
    _set(model, slice(None), scene, on_table, damping(on_table), w_object)
    for side, place, identified in zip(scene.sides, scene.arms, known, strict=True):
        ends, on_end = [f"{side}_pad"], identified or series(thing.stiffness, scene.pad.stiffness)
        if place.hand is not None:
            ends, on_end = [f"{side}_finger{k}" for k in (1, 2)], series(thing.stiffness, place.hand.stiffness)
        for end in ends:
            geom, weight = model.geom(end).id, weights[model.body(end).id]
            if scene.platform is not None and place.hand is None:  # which does not move
                _set(model, geom, scene, scene.platform.stiffness, scene.platform.damping, weight)
            else:
                _set(model, geom, scene, on_end, damping(on_end), w_object + weight)


def _set(
    model: mujoco.MjModel, geoms: slice | int, scene: Scene, stiffness: float, damping: float, inverse_mass: float
) -> None:
    """Set stiffness K, N/m, and damping C, Ns/m, of one point of a face: into MuJoCo's direct solref.

    MuJoCo holds a contact point with f = (a_ref - a_0) / (A + R), where a_ref = -(b / d) v - (k / d) r and R =
    A_diag (1 - d) / d, for solref = (-k, -b) and a constant impedance d; k and b are mass-normalised (1/s^2,
    1/s). At rest this is a spring of k / ((1 - d) A_diag) newton a metre whatever d is; with a small d it is that
    spring, and the damper b / ((1 - d) A_diag), in motion too. A_diag is what the compiler estimated for the two
    bodies, so K and C give k = K (1 - d) A_diag and b = C (1 - d) A_diag. Four points, the corners of the pad's face or
    of the object's base, share a face.
    """
    d = scene.contact.impedance
    normalised = (1.0 - d) * inverse_mass / POINTS_PER_FACE
    model.geom_solref[geoms] = (-stiffness * normalised, -damping * normalised)
    model.geom_solimp[geoms] = np.array([d, d, 1e-3, 0.5, 2.0])  # constant impedance


SUBSTEPS = 4
TIMESTEP_S = 0.25e-3  # the vendor's torque loop runs at 4 kHz
GRAVITY = 9.81
PROXIMITY_M = 5e-3  # links that come this near are seen before they touch

# what the model has none of, and MuJoCo would go through in each step
_NOT_THERE = ("EQUALITY", "FRICTIONLOSS", "LIMIT", "SPRING", "DAMPER", "ACTUATION", "SENSOR")

# collision masks: an arm meets the other arm, the table and the object, never itself
_LEFT, _RIGHT, _OBJECT, _TABLE = 1, 2, 4, 8
_MASKS = {
    "left": {"contype": _LEFT, "conaffinity": _RIGHT},
    "right": {"contype": _RIGHT, "conaffinity": _LEFT},
    "object": {"contype": _OBJECT, "conaffinity": _LEFT | _RIGHT},
    "table": {"contype": _TABLE, "conaffinity": _LEFT | _RIGHT | _OBJECT},
}


def _quaternion(R: Array) -> Array:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(R).ravel())
    return quaternion


def _add_box(
    body: mujoco.MjsBody, name: str, what: str, size: Array | Vector3, friction: float | None = None, **more: Any
) -> None:
    """Add a box to a body. what: its row of _MASKS; size: its edges, m; friction: sliding, None for MuJoCo's own."""
    rubs = {} if friction is None else {"friction": (friction, 0.0, 0.0)}
    body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=np.array(size) / 2.0, **_MASKS[what], **rubs, **more)


def _set_inertia(body: mujoco.MjsBody, mass: float, centre: Array, inertia: Array) -> None:
    """Give a body mass, centre (3,) and inertia (3, 3) about it, whatever its geoms are."""
    body.explicitinertial, body.mass, body.ipos = True, mass, centre
    body.fullinertia = (*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2])


def _add_arm(
    world: mujoco.MjsBody, side: str, place: ArmPlacement, arm: ArmDescription, scene: Scene, friction: float
) -> None:
    body = world.add_body(name=f"{side}_link0", pos=place.T_world_base_position, quat=place.T_world_base_wxyz)
    for index, link in enumerate(arm.links):
        if index > 0:
            T = arm.T_parent_joint[index - 1]
            body = body.add_body(name=f"{side}_{link.name}", pos=T[:3, 3], quat=_quaternion(T[:3, :3]))
            body.add_joint(name=f"{side}_joint{index}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, 0.0, 1.0))
        _set_inertia(body, link.mass, link.centre, link.inertia)
        for number, capsule in enumerate(link.capsules):
            T = capsule.T_link_capsule
            # within the gap a contact is seen and exerts nothing
            body.add_geom(
                name=f"{side}_{link.name}_{number}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, pos=T[:3, 3],
                quat=_quaternion(T[:3, :3]), size=(capsule.radius, capsule.half_length, 0.0), margin=PROXIMITY_M,
                gap=PROXIMITY_M, **_MASKS[side],
            )  # fmt: skip
    if place.hand is not None:
        _add_hand(body, side, place.hand, arm.flange_offset_z)
        return
    pad = place.pad or scene.pad
    T = pad.F_T_box
    middle = (0.0, 0.0, arm.flange_offset_z) + pad.F_T_face[:3, 3] - T[:3, 2] * (pad.size[2] / 2.0)
    body = body.add_body(name=f"{side}_pad", pos=middle)
    if pad.orientation_wxyz[1:] != (0.0, 0.0, 0.0):
        body.quat = _quaternion(T[:3, :3])
    mass = pad.mass
    if pad.centre is not None or pad.inertia is not None:
        mass, R = 0.0, T[:3, :3]
        _set_inertia(body, pad.mass, R.T @ (pad.F_x_centre - T[:3, 3]), R.T @ pad.I_centre @ R)
    # the pad's friction and stiffness count, not the larger of the two
    _add_box(body, f"{side}_pad", side, pad.size, friction, mass=mass, priority=1)


def _add_hand(link7: mujoco.MjsBody, side: str, hand: FrankaHand, flange_offset_z: float) -> None:
    """Put a hand on the flange: its body has the flange's frame, its fingers are bodies without joints."""
    body = link7.add_body(name=f"{side}_hand", pos=(0.0, 0.0, flange_offset_z))
    body.explicitinertial, body.mass, body.ipos, body.inertia = True, hand.mass, hand.centre, hand.inertia
    turn = np.cos(TURN_RAD / 2.0), 0.0, 0.0, np.sin(TURN_RAD / 2.0)
    _add_box(body, f"{side}_palm", side, PALM_SIZE, quat=turn, pos=(0.0, 0.0, PALM_SIZE[2] / 2.0))
    for number in range(2):
        name = f"{side}_finger{number + 1}"
        finger = body.add_body(name=name, quat=turn, pos=hand.finger_position(number, hand.start_width))
        _add_box(finger, name, side, FINGER_SIZE, hand.friction, mass=0.0, priority=1)


def cell_spec(
    scene: Scene, object_name: str, placement: ObjectPlacement, arms: tuple[ArmDescription, ...]
) -> mujoco.MjSpec:
    """Return the model of the cell with this object, to be compiled. `arms`: the drawn descriptions (n,)."""
    thing, table = scene.find(object_name), scene.table
    pad_friction, table_friction = scene.frictions(object_name)
    spec = mujoco.MjSpec()
    spec.modelname, spec.compiler.autolimits = scene.name, False
    option = spec.option
    option.timestep, option.gravity = TIMESTEP_S, (0.0, 0.0, -GRAVITY)
    option.integrator, option.cone = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = scene.contact.friction_ratio
    # MuJoCo 4.0.0's Newton solver has a wrong Hessian for sparse ones (mujoco#3767)
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    # a simulation that diverges must stop, not start again in silence; islands cost more than they save here
    for flag in ("AUTORESET", "ISLAND", *_NOT_THERE):
        option.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    world = spec.worldbody
    for side, place, arm in zip(scene.sides, scene.arms, arms, strict=True):
        _add_arm(world, side, place, arm, scene, pad_friction)
    _add_box(world, "table", "table", (*table.size_xy, table.top_z), table_friction,
             pos=(*table.centre_xy, table.top_z / 2.0))  # fmt: skip
    if scene.platform is not None:
        _add_platform(world, scene.platform)
    if placement.on_wedge:
        _add_wedge(world, table_friction, thing, placement)
    body = world.add_body(name="object", pos=placement.position, quat=placement.wxyz)
    body.add_freejoint(name="object")
    _add_box(body, "object", "object", thing.size, table_friction, mass=thing.mass)
    return spec


def _add_platform(world: mujoco.MjsBody, platform: Platform) -> None:
    angle = -np.radians(platform.inclination_deg)  # about y, which would turn x down
    down = platform.size[2] / 2.0 * np.array([np.sin(angle), 0.0, np.cos(angle)])
    turn = np.cos(angle / 2.0), 0.0, np.sin(angle / 2.0), 0.0
    _add_box(world, "platform", "table", platform.size, pos=np.array(platform.centre) - down, quat=turn)


def _add_wedge(world: mujoco.MjsBody, friction: float, thing: GraspObject, placement: ObjectPlacement) -> None:
    """Put a wedge under a tilted object: two thirds of its underside, from the edge on the table upwards."""
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, np.array(placement.wxyz))
    R = R.reshape(3, 3)
    half = np.array(thing.size) / 2.0
    low = -1.0 if R[2, 1] > 0.0 else 1.0  # which of the object's sides, along its y, is the lower one
    size = half * (1.0, 2.0 / 3.0, 0.3)
    centre = np.array(placement.position) + R @ (0.0, low * half[1] / 3.0, -half[2] - size[2])
    _add_box(world, "wedge", "table", 2.0 * size, friction, pos=centre, quat=placement.wxyz)


def build_cell(
    scene: Scene, object_name: str, placement: ObjectPlacement, arms: tuple[ArmDescription, ...],
    stiffness: tuple[float | None, ...],
) -> mujoco.MjModel:  # fmt: skip
    """Compile the cell, with its contacts set. stiffness: see set_contacts. Raises UnknownObject."""
    model = cell_spec(scene, object_name, placement, arms).compile()
    if model.nv != JOINTS * len(arms) + 6:
        raise ValueError(f"the cell has {model.nv} degrees of freedom, expected {JOINTS * len(arms) + 6}")
    set_contacts(model, scene, scene.find(object_name), stiffness)
    return model
