"""The plant: one arm or two with flexible joints and an object before them, stepped by the millisecond."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import chain
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from hal.base.arrays import Array
from hal.compilation import bound
from hal.displacement import Displacement
from hal.errors import HardwareError
from hal.robots import RobotModel
from sim_robot.arm_description import JOINTS, ArmDescription, Link, arm_description
from sim_robot.kinematics import KINEMATICS_RECORD, forward_kinematics
from sim_robot.model import build_cell
from sim_robot.near_geoms import look_at_all, masks_of, near_of, pairs_of
from sim_robot.plant_parameters import PlantParameters
from sim_robot.profile import ARM_DRAW, ForceEstimate, OwnArm, Profile, Twin, load_profile
from sim_robot.scene import PlacementScatter, Scene
from sim_robot.substeps import JOINT_RECORD, MOTOR_RECORD, advance_millisecond

SMALLEST_FACTOR = 0.2  # a draw never leaves a mass or a stiffness at zero or below, however large the scatter


@dataclass(frozen=True, slots=True)
class DrawnArm:
    """One arm as it is in this cell. Arrays (7,), units as in JointParameters; gravity_factor is a ratio."""

    description: ArmDescription
    B: Array
    B_theta: Array
    K: Array
    D: Array
    friction_p1: Array
    friction_p2: Array
    friction_p3: Array
    gravity_factor: Array


def _around_one(generator: np.random.Generator, fraction: float, count: int = JOINTS) -> Array:
    return np.maximum(1.0 + fraction * generator.standard_normal(count), SMALLEST_FACTOR)


def draw_arm(description: ArmDescription, parameters: PlantParameters, generator: np.random.Generator) -> DrawnArm:
    """Draw one arm. The order of the draws is fixed, so that a seed names a plant."""
    joints, scatter = parameters.joints, parameters.scatter
    around_one = partial(_around_one, generator)

    def drawn(link: Link) -> Link:
        # one factor for the whole tensor keeps it a possible inertia
        mass, inertia = around_one(scatter.link_mass, 1)[0], around_one(scatter.link_inertia, 1)[0]
        centre = link.centre + 1e-3 * scatter.link_centre_mm * generator.standard_normal(3)
        return replace(link, mass=float(link.mass * mass), inertia=link.inertia * inertia, centre=centre)

    return DrawnArm(
        description=replace(description, links=tuple(drawn(link) for link in description.links)),
        B=np.array(joints.B) * around_one(scatter.motor_inertia),
        B_theta=np.array(joints.B_theta) * around_one(scatter.motor_inertia),
        K=np.array(joints.K) * around_one(scatter.joint_stiffness),
        D=np.array(joints.D) * around_one(scatter.joint_damping),
        friction_p1=np.array(joints.friction_p1) * around_one(scatter.friction),
        friction_p2=np.array(joints.friction_p2) * around_one(scatter.friction),
        friction_p3=np.array(joints.friction_p3),
        gravity_factor=around_one(scatter.gravity_compensation),
    )


def own_model(model: RobotModel, own: OwnArm, generator: np.random.Generator) -> RobotModel:
    """Return the model as the arm itself has it, inertial parameters of its URDF drawn; the model where none differ."""
    if not (own.link_mass or own.link_inertia or own.link_centre_mm):
        return model
    root = ElementTree.fromstring(model.urdf)
    for inertial in root.iter("inertial"):
        mass, inertia = (_around_one(generator, fraction, 1)[0] for fraction in (own.link_mass, own.link_inertia))
        moved = 1e-3 * own.link_centre_mm * generator.standard_normal(3)
        for element, factor in (("mass", mass), ("inertia", mass * inertia)):
            for values in inertial.iter(element):
                values.attrib.update({key: repr(float(value) * float(factor)) for key, value in values.items()})
        for origin in inertial.iter("origin"):
            centre = np.array([float(word) for word in origin.get("xyz", "0 0 0").split()]) + moved
            origin.set("xyz", " ".join(map(repr, centre.tolist())))
    return replace(model, urdf=ElementTree.tostring(root, encoding="unicode"))


@dataclass(frozen=True, slots=True)
class EstimateError:
    """What an arm's estimate of external torques has: offset (7,) Nm, gravity (7,) shares, payload kg, delay ms."""

    offset: Array
    gravity: Array
    payload_kg: float
    delay_ms: int


def draw_estimate_error(force: ForceEstimate, generator: np.random.Generator, twin: Twin) -> EstimateError:
    """Draw the error of one arm's estimate; zeros of an ideal one; what was identified of it is not drawn."""
    normal = generator.standard_normal
    offset = np.array(force.torque_offset) * normal(JOINTS)
    return EstimateError(
        offset=offset if twin.torque_offset is None else np.array(twin.torque_offset),
        gravity=force.gravity_error * normal(JOINTS),
        payload_kg=force.payload_error_kg * float(normal()),
        delay_ms=force.delay_ms if twin.estimate_delay_ms is None else twin.estimate_delay_ms,
    )


def with_own_friction(arm: DrawnArm, own: OwnArm, generator: np.random.Generator) -> DrawnArm:
    """Return the arm with friction that differs by more than the scatter of plant.toml."""
    if not own.friction:
        return arm
    return replace(arm, friction_p1=arm.friction_p1 * _around_one(generator, own.friction))


def as_twin(arm: DrawnArm, twin: Twin) -> DrawnArm:
    """Return the arm with what was identified of it in the place of what was drawn."""
    known: dict[str, Any] = {
        field.name: np.array(getattr(twin, field.name))
        for field in fields(arm) if getattr(twin, field.name, None) is not None
    }  # fmt: skip
    if twin.payload_kg:
        *links, last = arm.description.links
        loaded = _with_mass(last, twin.payload_kg, np.array(twin.payload_centre))
        known["description"] = replace(arm.description, links=(*links, loaded))
    return replace(arm, **known) if known else arm


def _with_mass(link: Link, mass: float, place: Array) -> Link:
    whole = link.mass + mass
    centre = (link.mass * link.centre + mass * place) / whole
    inertia = link.inertia.copy()
    for part, where in ((link.mass, link.centre - centre), (mass, place - centre)):
        inertia += part * (where @ where * np.eye(3) - np.outer(where, where))
    return replace(link, mass=whole, centre=centre, inertia=inertia)


EDGE_RAD = 2e-3
# far from everything that collides, beyond what motion capture could see: m along the world's x
AWAY_M = 10.0


class SimulationDiverged(HardwareError):
    """The simulation produced an absurd velocity or a number that is not finite, and cannot go on."""


def faces(scene: Scene) -> Array:
    """Return the frames of the arms' pads, or of their hands' fingertips, in that of joint 7, (n, 4, 4), m."""
    T = np.tile(np.eye(4), (len(scene.arms), 1, 1))
    for side, (place, pad) in enumerate(zip(scene.arms, scene.pads, strict=True)):
        if place.hand is None:
            T[side] = pad.F_T_face
        else:
            T[side, 2, 3] = place.hand.tip_offset_z
        T[side, 2, 3] = arm_description(place.robot).flange_offset_z + T[side, 2, 3]
    return T


def _pad_faces_y(scene: Scene) -> tuple[float, float]:
    """Return where the pads begin along y, m, by the nominal kinematics; infinity for a hand, and a missing arm."""
    y, body, from_base = [], np.zeros(1, KINEMATICS_RECORD)[0], np.zeros(3)
    for place, face in zip(scene.arms, faces(scene), strict=True):
        body["T_parent_joint"], body["joint_T_face"] = arm_description(place.robot).T_parent_joint, face
        forward_kinematics(body, np.array(place.home))
        mujoco.mju_rotVecQuat(from_base, body["T"][:3, 3].copy(), np.array(place.T_world_base_wxyz))
        y.append(place.T_world_base_position[1] + float(from_base[1]))
    left, right = (place is not None and place.hand is None for place in (scene.left, scene.right))
    # arms that were exchanged stand at each other's side
    return max(y) if left else np.inf, min(y) if right else -np.inf


class Plant:
    """The physical cell. Owns MuJoCo's model and data; deterministic for a seed.

    Arrays of all arms have shape (n, ...), in the order of `Scene.sides`; an arm's `side` is its index there. `joints`
    and `motors` are records (n,). Friction is the sigmoid of JointParameters as seen at the commanded torque, tau_fric
    of (7)-(10); at the motor itself it is B / B_theta times that.
    """

    def __init__(
        self, scene: Scene, parameters: PlantParameters, object_name: str,
        displacement: Displacement | float, seed: int, arms_seed: int | None = None, tilt_deg: float = 0.0,
        profile: Profile | None = None,
    ) -> None:  # fmt: skip
        """Build the cell at rest, all arms held. arms_seed: of the arms. Raises UnknownObject, ObjectOutOfReach."""
        arms_seed = seed if arms_seed is None else arms_seed
        _, placement_seed = np.random.SeedSequence([seed, 0]).spawn(2)
        arms_draw, _ = np.random.SeedSequence([arms_seed, 0]).spawn(2)
        scatter = np.random.default_rng(placement_seed)
        placement = scene.place(object_name, displacement, _pad_faces_y(scene), scatter, tilt_deg)
        own = np.random.default_rng(np.random.SeedSequence([arms_seed, ARM_DRAW]))
        generator = np.random.default_rng(arms_draw)
        profile = self.profile = load_profile() if profile is None else profile
        self.sides = scene.sides  # the arms' names
        self.robots = tuple(own_model(place.robot, profile.arm, own) for place in scene.arms)
        twins = profile.twins(scene.sides)
        self.estimate_errors = tuple(draw_estimate_error(profile.force, own, twin) for twin in twins)
        arms: list[DrawnArm] = []
        for model, twin in zip(self.robots, twins, strict=True):
            drawn = draw_arm(arm_description(model), parameters.of(model), generator)
            arms.append(as_twin(with_own_friction(drawn, profile.arm, own), twin))
        stiffness = tuple(twin.contact_stiffness for twin in twins)
        self.model = build_cell(scene, object_name, placement, tuple(arm.description for arm in arms), stiffness)
        self.data = mujoco.MjData(self.model)
        self.ticks = 0  # ms since the start
        self.away = self.gone = False  # the object is off the table, for now or for good
        # what is on the flanges, and where in it an arm is pushed: the middle of its face
        hands = [(side, place.hand is not None) for side, place in zip(scene.sides, scene.arms, strict=True)]
        self.pad_bodies = self._bodies(f"{side}_{'hand' if hand else 'pad'}" for side, hand in hands)
        self.finger_bodies = tuple(
            self._bodies(f"{side}_finger{number}" for number in (1, 2) if hand) for side, hand in hands
        )
        (self._object_body,), links = self._bodies(["object"]), self._bodies(f"{side}_link1" for side in scene.sides)
        ends = [
            place.hand.tip_offset_z if place.hand else pad.size[2] / 2.0
            for place, pad in zip(scene.arms, scene.pads, strict=True)
        ]
        self.face_in_pad = np.array([(0.0, 0.0, z) for z in ends])
        self._pushes = np.zeros((len(arms), 3)), np.zeros((len(arms), JOINTS))
        self._pushed = False
        self._jacobian = np.zeros((3, self.model.nv))
        data = self.data
        # the object's first coordinate in qpos, and in qvel
        self.first_of_object = JOINTS * len(arms)
        data.qpos[: self.first_of_object] = np.concatenate([place.home for place in scene.arms])
        self._object_place = data.qpos[self.first_of_object :].copy()
        mujoco.mj_forward(self.model, data)
        self.joints, self.motors = np.zeros(len(arms), JOINT_RECORD), np.zeros(len(arms), MOTOR_RECORD)
        self._tau_command, self._holding = self.motors["tau_command"], self.motors["holding"]
        self._hold_inertia = np.zeros((len(arms), JOINTS))
        for side, arm in enumerate(arms):
            self._fill(side, arm, parameters)
            self.joints[side]["payload_error"] = self.estimate_errors[side].payload_kg
        model, masks = self.model, masks_of(self.model)
        collision = (model.geom_contype, model.geom_conaffinity, model.body_contype, model.body_conaffinity)
        self.look_at_all = bound(look_at_all, masks, *collision)
        # what is remembered of where the geoms are: near["fixed"] = 1 has MuJoCo look at all of them, always
        self.near = near_of(model, links, self._object_body, any(hand for _, hand in hands))
        # compiled, or loaded from the cache, before a clock runs
        self._advance_millisecond = bound(
            advance_millisecond,
            self.model._address, data._address, data.qpos, data.qvel, data.qfrc_applied, data.qfrc_constraint,
            data.xanchor, data.xaxis, data.subtree_com, self.model.body_subtreemass,
            np.array(links, dtype=np.int64), self.joints, self.motors, pairs_of(model), masks, self.near,
            *collision, model.geom_type, model.geom_size, model.geom_rbound, data.geom_xpos, data.geom_xmat,
        )  # fmt: skip

    @classmethod
    def nominal(
        cls, scene: Scene, parameters: PlantParameters, object_name: str, displacement: Displacement | float = 0.0
    ) -> "Plant":
        """Return a plant without any scatter, the object exactly in its place."""
        exact = replace(scene, placement_scatter=PlacementScatter(0.0, 0.0))
        return cls(exact, parameters.nominal(), object_name, displacement, seed=0)

    def _bodies(self, names: Iterable[str]) -> tuple[int, ...]:
        return tuple(self.model.body(name).id for name in names)

    def _fill(self, side: int, arm: DrawnArm, parameters: PlantParameters) -> None:
        joint, motor, data = self.joints[side], self.motors[side], self.data
        for name in ("B", "B_theta", "K", "D", "friction_p1", "friction_p2", "friction_p3", "gravity_factor"):
            joint[name] = getattr(arm, name)
        joint["friction_offset"] = arm.friction_p1 / (1.0 + np.exp(-arm.friction_p2 * arm.friction_p3))
        M = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, data, M)
        dofs = slice(JOINTS * side, JOINTS * (side + 1))
        joint["hold_stiffness"] = parameters.holding.stiffness
        self._hold_inertia[side] = np.diag(M)[dofs] + arm.B_theta
        joint["hold_damping"] = 2.0 * np.sqrt(joint["hold_stiffness"] * self._hold_inertia[side])
        joint["hold_tau_max"] = self.robots[side].limits.tau_max
        # the gears start wound up by gravity, so that nothing moves at the start
        motor["tau_J"] = motor["tau_gravity"] = data.qfrc_bias[dofs]
        motor["theta"] = data.qpos[dofs] + motor["tau_J"] / arm.K
        motor["theta_hold"], motor["holding"] = motor["theta"], 1

    def advance(self) -> None:
        """Advance by 1 ms. Raises SimulationDiverged."""
        if self._pushed:
            self._apply_pushes()
        if self.away:
            position, velocity = self.data.qpos[self.first_of_object :], self.data.qvel[self.first_of_object :]
            position[:3], velocity[:] = (AWAY_M, 0.0, 0.0), 0.0
        self.ticks += 1
        if not self._advance_millisecond():
            raise SimulationDiverged(
                f"the simulation diverged {self.ticks} ms after its start (a velocity beyond reason); "
                "start a new trial, and look at the last commanded torques"
            )

    def command(self, side: int, tau: Array) -> None:
        """Take a torque, (7,), Nm, gravity excluded, for an arm until the next one."""
        self._tau_command[side] = tau
        self._holding[side] = 0

    def hold(self, side: int) -> None:
        motor = self.motors[side]
        motor["tau_command"], motor["theta_hold"], motor["holding"] = 0.0, motor["theta"], 1
        motor["dtheta_hold"] = 0.0
        # an arm that stopped at the edge of its range holds just inside it, so that it can be recovered
        q, hold = motor["theta"] - motor["tau_J"] / self.joints[side]["K"], motor["theta_hold"]
        limits = self.robots[side].limits
        below, above = limits.q_lower + EDGE_RAD - q, q - limits.q_upper + EDGE_RAD
        hold += np.where((below > 0.0) & (below < 4.0 * EDGE_RAD), below, 0.0)
        hold -= np.where((above > 0.0) & (above < 4.0 * EDGE_RAD), above, 0.0)

    def track(self, side: int, q: Array, dq: Array) -> None:
        """Let the arm's joint impedance go to q at dq, (7,) rad and rad/s, within the next ms and on from there."""
        motor, joint = self.motors[side], self.joints[side]
        # the gears give by what gravity winds them up
        motor["theta_hold"] = q + motor["tau_gravity"] / joint["K"] - 1e-3 * dq
        motor["dtheta_hold"], motor["tau_command"], motor["holding"] = dq, 0.0, 1

    def set_hold(self, side: int, stiffness: Array) -> None:
        """Set the joint impedance's stiffness, (7,) Nm/rad; the damping follows, critical."""
        joint = self.joints[side]
        joint["hold_stiffness"] = stiffness
        joint["hold_damping"] = 2.0 * np.sqrt(stiffness * self._hold_inertia[side])

    def push(self, side: int, force: Array, torque: Array | float = 0.0) -> None:
        """Push until changed: the middle of a pad's face, (3,) N along the world's axes, and the joints, (7,) Nm."""
        self._pushes[0][side], self._pushes[1][side] = force, torque
        self._pushed = True

    def _apply_pushes(self) -> None:
        data = self.data
        for side, (body, force, torque) in enumerate(zip(self.pad_bodies, *self._pushes, strict=True)):
            point = data.xpos[body] + data.xmat[body].reshape(3, 3) @ self.face_in_pad[side]
            mujoco.mj_jac(self.model, data, self._jacobian, None, point, body)
            dofs = slice(JOINTS * side, JOINTS * (side + 1))
            self.motors[side]["tau_applied"] = self._jacobian[:, dofs].T @ force + torque
        self._pushed = any(push.any() for push in self._pushes)

    def put_object_back(self) -> bool:
        """Put the object where it began, or off the table where a pad is in the way; return whether it is there."""
        if self.gone:
            return True
        data, first = self.data, self.first_of_object
        self.look_at_all()
        was = data.qpos[first:].copy(), data.qvel[first:].copy()
        held = self._pad_touches_object()
        data.qpos[first:], data.qvel[first:] = self._object_place, 0.0
        if not self._pad_touches_object():
            self.away = False
            return True
        self.away = not held
        data.qpos[first:], data.qvel[first:] = was
        mujoco.mj_forward(self.model, data)
        return False

    def _pad_touches_object(self) -> bool:
        mujoco.mj_forward(self.model, self.data)
        pairs = self.model.geom_bodyid[self.data.contact.geom]
        ends = (*self.pad_bodies, *chain.from_iterable(self.finger_bodies))
        return bool(((pairs == self._object_body).any(axis=1) & np.isin(pairs, ends).any(axis=1)).any())
