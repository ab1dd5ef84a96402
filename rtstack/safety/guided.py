"""The judge's limits while a person moves the arms by hand: slower and softer, and as wide as the arms stand.

A judge that stops an arm where it stands beyond a limit does not let it go back either. These limits are the only
ones that are wider than a cell's: by where the arm stands and a little more, never beyond the robot's own limit. They
come from the measured state, not from a file or a request, and are made anew each time that a person begins.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hal.base.arrays import Array
from rtstack.safety.body import Base, Tool, arm_body
from rtstack.safety.geometry import arm_distance, place_arm
from rtstack.safety.limits import PairLimits, SafetyLimits
from rtstack.safety.records import StopProfile, empty_memory, rules

# all ours. What a hand may move: 0.25 m/s is the reduced speed of ISO 10218-1 for a person beside the robot
SPEED_M_S = 0.25
SPEED_RAD_S = 0.6
BEYOND_RAD_S = 0.3  # of an arm that is beyond a limit; its law leads it back at a sixth of that
TORQUE_SHARE = 0.5  # of the external torque that the cell allows
# how much further out than it stands an arm may come before the judge stops it: what a spring gives under a hand
FURTHER_RAD, FURTHER_M = 0.02, 0.01
# from the robot's own limit, where its reflex is: the encoder's noise is a thousandth of it
ROBOT_MARGIN_RAD = 5e-4
NOISE_RAD_S = 0.02  # more than the measured velocity of a joint at rest, and as much as a hand's tremor
SMALLEST_DISTANCE_M = 0.005
_FAR_M = 10.0


@dataclass(frozen=True, slots=True)
class Standing:
    """Where the arms stand: q (arms, 7) rad; face (arms, 3) m, the middle of the pad's face in the world; distance m,
    infinite where there is one arm."""

    q: Array
    face: Array
    distance: float


def standing(q: Array, bases: Sequence[Base], tools: Sequence[Tool], limits: PairLimits) -> Standing:
    """Return where arms at q (arms, 7) stand, by the judge's own picture of them."""
    bodies = [arm_body(*arm) for arm in zip(bases, tools, strict=True)]
    memories, dq = empty_memory(len(bodies)), np.zeros(7)
    others = reversed(bodies)
    each = [rules(own, StopProfile(), *two) for own, *two in zip(limits, bodies, others, strict=True)]
    for k, rule in enumerate(each):
        place_arm(q[k], dq, rule[0], memories[k])
    distance = np.inf if len(each) == 1 else float(arm_distance(memories[0], memories[1], each[0][0], _FAR_M))
    return Standing(q.copy(), memories["face_world"].copy(), distance)


def beyond(limits: PairLimits, where: Standing, sides: Sequence[str]) -> tuple[str, ...]:
    """Return a line for each limit that the arms, of these sides, stand beyond."""
    lines = []
    for side, name in enumerate(sides):
        own = limits[side]
        for joint, (q, low, high) in enumerate(zip(where.q[side], own.q_lower, own.q_upper, strict=True), 1):
            if not low <= q <= high:
                lines.append(f"{name} arm, joint {joint}: {q:.3f} rad, allowed {low:.3f} to {high:.3f}")
        for axis, (place, low, high) in enumerate(zip(where.face[side], own.ee_lower, own.ee_upper, strict=True)):
            if not low <= place <= high:
                lines.append(f"{name} pad, {'xyz'[axis]}: {place:.3f} m, allowed {low:.3f} to {high:.3f}")
    least = max(own.arm_distance_min for own in limits)
    if where.distance < least:
        lines.append(f"the arms are {1e3 * where.distance:.0f} mm apart, allowed {1e3 * least:.0f}")
    return tuple(lines)


def outside_robot(limits: PairLimits, where: Standing, sides: Sequence[str]) -> str:
    """Return which joint stands at the robot's own limit, where no program may move it, "" for none."""
    for side, name in enumerate(sides):
        arm = limits[side].arm
        for joint, (q, low, high) in enumerate(zip(where.q[side], arm.q_lower, arm.q_upper, strict=True), 1):
            if not low + ROBOT_MARGIN_RAD < q < high - ROBOT_MARGIN_RAD:
                return f"{name} arm, joint {joint}: {q:.4f} rad, the robot's own limits are {low:g} and {high:g}"
    return ""


def guided_limits(limits: PairLimits, where: Standing) -> PairLimits:
    """Return the judge's limits for arms that stand there and are moved by hand."""
    return reaching(tuple(_one(own, where, side) for side, own in enumerate(limits)), where, FURTHER_M)


def reaching(limits: PairLimits, where: Standing, further_m: float) -> PairLimits:
    """Return the judge's limits with boxes that reach to where the pads stand, and so much further."""
    wider = []
    for own, face in zip(limits, where.face, strict=True):
        low, high = np.minimum(own.ee_lower, face - further_m), np.maximum(own.ee_upper, face + further_m)
        wider.append(replace(own, ee_lower=tuple(low.tolist()), ee_upper=tuple(high.tolist())))
    return tuple(wider)


def _one(limits: SafetyLimits, where: Standing, side: int) -> SafetyLimits:
    arm, q = limits.arm, where.q[side]
    slow = beyond_limits(limits, where, side)
    low, high = np.asarray(limits.q_lower), np.asarray(limits.q_upper)
    near = np.minimum(q - low, high - q) < (arm.velocity_offset + NOISE_RAD_S) ** 2 / (2.0 * arm.deceleration)
    low = np.where(q < low, np.maximum(q - FURTHER_RAD, arm.q_lower + ROBOT_MARGIN_RAD), low)
    high = np.where(q > high, np.minimum(q + FURTHER_RAD, arm.q_upper - ROBOT_MARGIN_RAD), high)
    speed = BEYOND_RAD_S if slow else SPEED_RAD_S
    nearest = max(SMALLEST_DISTANCE_M, where.distance - FURTHER_M)
    return replace(
        limits,
        q_lower=tuple(low.tolist()),
        q_upper=tuple(high.tolist()),
        dq_max=tuple(np.minimum(limits.dq_max, speed).tolist()),
        ee_speed_max=min(limits.ee_speed_max, SPEED_M_S),
        tau_ext_max=tuple((TORQUE_SHARE * np.asarray(limits.tau_ext_max)).tolist()),
        arm_distance_min=min(limits.arm_distance_min, nearest),
        # at a limit the velocity law allows no velocity at all: the noise of a joint at rest would stop the arm
        arm=replace(arm, velocity_offset=np.where(near, 0.0, arm.velocity_offset)),
    )


def beyond_limits(limits: SafetyLimits, where: Standing, side: int) -> bool:
    """Return whether this arm stands beyond a limit."""
    q, face = where.q[side], where.face[side]
    joints = np.any((q < np.asarray(limits.q_lower)) | (q > np.asarray(limits.q_upper)))
    box = np.any((face < np.asarray(limits.ee_lower)) | (face > np.asarray(limits.ee_upper)))
    return bool(joints or box or where.distance < limits.arm_distance_min)
