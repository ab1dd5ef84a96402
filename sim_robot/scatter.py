"""One draw of the plant: the nominal parameters, scattered by the seed."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim_robot.arm_description import JOINTS, ArmDescription, Link
from sim_robot.plant_parameters import PlantParameters

Array = NDArray[np.float64]
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


def draw_arm(description: ArmDescription, parameters: PlantParameters, generator: np.random.Generator) -> DrawnArm:
    """Draw one arm. The order of the draws is fixed, so that a seed names a plant."""
    joints, scatter = parameters.joints, parameters.scatter

    def around_one(fraction: float, count: int = JOINTS) -> Array:
        return np.maximum(1.0 + fraction * generator.standard_normal(count), SMALLEST_FACTOR)

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
