"""One draw of the plant: the nominal parameters, scattered by the seed."""

from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any
from xml.etree import ElementTree

import numpy as np

from hal.base.arrays import Array
from hal.robots import RobotModel
from sim_robot.arm_description import JOINTS, ArmDescription, Link
from sim_robot.plant_parameters import PlantParameters
from sim_robot.profile import ForceEstimate, OwnArm, Twin

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

    links = tuple(drawn(link) for link in description.links)
    return DrawnArm(
        description=replace(description, links=links),
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
