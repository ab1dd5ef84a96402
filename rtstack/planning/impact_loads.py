"""What an impact does to the joints: the rigid map says where it ends, this how hard it is on the way there.

The map's own scene at its configuration, for the IMPACT_S in which the pads come to rest on the object: each pad gives
way as a static squeeze shows, each joint is a motor and a link with a spring between, whose torque it measures.
"""

from dataclasses import dataclass

import numpy as np

from hal.base.arrays import Array
from hal.robots import FR3
from rtstack.control.parameters import InertiaParameters
from rtstack.impact_map.problem import JOINTS, Problem
from rtstack.impact_map.scene import joint_inertia
from rtstack.planning.planned import PlannedMotion

GRAVITY = 9.81

IMPACT_S = 0.04  # the largest torques of the wrist come within 5 ms, those of the base within 20 ms
STEP_S = 5e-5  # a fifth of what the wrist's link on its joint's spring would stand
# No joint stiffness or damping of an FR3 is published. These, the damping of a contact and the two of the table and of
# friction are ours, chosen on 60 random plans (tests/studies/random_plans.py says of which seeds). Measured over
# predicted peaks there: the residual of joint 1 0.97 +- 0.04, the torque of joint 6 0.90 +- 0.14
JOINT_STIFFNESS = 1e4  # Nm/rad
JOINT_DAMPING = 8.0  # Nms/rad
DAMPING_RATIO = 0.5  # of the object's mass on one contact
TABLE_GIVE = 5e-6  # m/N, of an object's base on the table
SLIP_DAMPING = 500.0  # Ns/m at each corner: friction below Coulomb's bound


@dataclass(frozen=True, slots=True)
class ImpactLoads:
    """Largest magnitudes in one arm: torque (7,) Nm as the joints measure it; external (7,) Nm: of the contact as the
    momentum observer sees it; fastest, slowest (7,) rad/s: of the links' velocities; power W: |sum of tau_J dq|."""

    torque: Array
    external: Array
    fastest: Array
    slowest: Array
    power: float


def impact_loads(planned: PlannedMotion, give: float, mass: float) -> dict[str, ImpactLoads]:
    """Return the loads of each arm that takes part in the impact. give: m/N, of one pad on the object; mass: kg."""
    problem = planned.map.problem
    arms = [side for side in planned.sides if side in problem.names]
    where = [problem.slices[problem.names.index(side)] for side in arms]
    joints = np.concatenate([np.arange(its.start, its.stop) for its in where])
    robots = [problem.bodies[problem.names.index(side)].robot or FR3 for side in arms]
    links = problem.M.copy()
    links[joints, joints] -= np.concatenate([joint_inertia(planned.request.inertia, robot) for robot in robots])
    compliance = np.linalg.inv(links)
    inertia = np.concatenate([robot.B_theta for robot in robots])
    first = planned.recording.impact - 1
    ticks = slice(first, first + 1 + round(IMPACT_S * 1e3))
    torque = np.hstack([planned.torque(planned.sides.index(side), ticks) for side in arms])
    stiffness, damping, pressed = _contacts(problem, give, mass)
    weight = np.zeros(len(problem.velocity))
    weight[problem.slices[problem.names.index("object")].start + 2] = -GRAVITY * mass
    normal, along = problem.J[2::3], np.delete(problem.J, np.s_[2::3], axis=0)
    gain = STEP_S * InertiaParameters().observer_gain_hz
    velocity, motor = problem.velocity.copy(), problem.velocity[joints].copy()
    twist, residual = np.zeros(len(joints)), np.zeros(len(joints))
    steps = round(IMPACT_S / STEP_S)
    measured, external = np.empty((steps, len(joints))), np.empty((steps, len(joints)))
    turning = np.empty((steps, len(joints)))
    for k in range(steps):
        force = np.where(pressed > 0.0, np.maximum(stiffness * pressed - damping * (normal @ velocity), 0.0), 0.0)
        slip = (along @ velocity).reshape(-1, 2)
        speed = np.hypot(slip[:, 0], slip[:, 1]) + 1e-12
        held = np.minimum(problem.friction * force, SLIP_DAMPING * speed) / speed
        total = normal.T @ force - along.T @ (held[:, None] * slip).ravel()
        residual += gain * (total[joints] - residual)
        spring = JOINT_STIFFNESS * twist + JOINT_DAMPING * (motor - velocity[joints])
        commanded = torque[k * (len(torque) - 1) // steps + 1] - torque[0]
        measured[k], external[k], turning[k] = torque[0] + spring, residual, velocity[joints]
        total += weight
        total[joints] += spring
        velocity += STEP_S * (compliance @ total)
        motor += STEP_S * (commanded - spring) / inertia
        twist += STEP_S * (motor - velocity[joints])
        pressed -= STEP_S * (normal @ velocity)
    peak, outside = np.abs(measured).max(axis=0), np.abs(external).max(axis=0)
    power = np.abs((measured * turning).reshape(steps, -1, JOINTS).sum(axis=2)).max(axis=0)
    found = {}
    for k, side in enumerate(arms):
        its = np.s_[JOINTS * k : JOINTS * (k + 1)]
        turned = turning[:, its]
        found[side] = ImpactLoads(peak[its], outside[its], turned.max(axis=0), turned.min(axis=0), float(power[k]))
    return found


def _contacts(problem: Problem, give: float, mass: float) -> tuple[Array, Array, Array]:
    """Return stiffness N/m and damping Ns/m of each contact point, and how far it is pressed in at the start, m."""
    stiffness, damping, pressed = (np.zeros(len(problem.friction)) for _ in range(3))
    for contact, rows in zip(problem.contacts, problem.points, strict=True):
        on_table = contact.between[0] == "object"
        softness, points = TABLE_GIVE if on_table else give, rows.stop - rows.start
        stiffness[rows] = 1.0 / softness / points
        damping[rows] = 2.0 * DAMPING_RATIO * np.sqrt(mass / softness) / points
        pressed[rows] = GRAVITY * mass * softness * on_table
    return stiffness, damping, pressed
