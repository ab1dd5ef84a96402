"""What is wrong with a state and a desired torque: the judge's list, compiled. Each answer is the code of a Cause."""

import math

from hal.compilation import compiled
from rtstack.safety.geometry import arm_distance
from rtstack.safety.reasons import Cause

# plain integers: compiled code has no enumeration with texts
NOT_FINITE = int(Cause.NOT_FINITE)
JOINT_POSITION = int(Cause.JOINT_POSITION)
JOINT_VELOCITY = int(Cause.JOINT_VELOCITY)
MEASURED_TORQUE = int(Cause.MEASURED_TORQUE)
EXTERNAL_TORQUE = int(Cause.EXTERNAL_TORQUE)
RESIDUAL = int(Cause.RESIDUAL)
WORKSPACE = int(Cause.WORKSPACE)
SPEED = int(Cause.SPEED)
POWER = int(Cause.POWER)
ARM_DISTANCE = int(Cause.ARM_DISTANCE)
STATE_GAP = int(Cause.STATE_GAP)
STATE_AGE = int(Cause.STATE_AGE)
TIME_BACKWARDS = int(Cause.TIME_BACKWARDS)
PAIR_SKEW = int(Cause.PAIR_SKEW)
FORCE = int(Cause.FORCE)
WHOLE_ARM = -1
TICK_NS = 1_000_000
S = 1e-9


@compiled
def note(memory, cause, joint, value, bound):
    """Remember what was found, and return its cause; once a stop is latched its evidence stays."""
    if memory["stopping"] == 0:
        memory["joint"] = joint
        memory["value"] = value
        memory["bound"] = bound
    return cause


@compiled
def take_time(sample, other, rule, memory):
    """Count what has passed since the last state, here and for the other arm; return a reason to stop, or 0.

    The clock counts from its first step: a robot that waits for its first command shows its first state several times.
    """
    changed = False
    for i in range(7):
        q, dq, tau = sample["q"][i], sample["dq"][i], sample["tau_J"][i]
        if q != memory["q"][i] or dq != memory["dq"][i] or tau != memory["tau_J"][i]:
            changed = True
        memory["q"][i], memory["dq"][i], memory["tau_J"][i] = q, dq, tau
    gap = sample["t_ns"] - memory["t_ns"]
    memory["t_ns"] = sample["t_ns"]
    if memory["seen"] == 0:
        memory["seen"] = 1
        return 0
    if gap < 0:
        return note(memory, TIME_BACKWARDS, WHOLE_ARM, gap * S, 0.0)
    if memory["seen"] == 1:
        if gap > 0:
            memory["seen"] = 2
        return 0
    other["silent_ns"] += gap
    if changed and gap > 0:
        memory["stale_ns"] = 0
        memory["silent_ns"] = 0
    else:
        memory["stale_ns"] += max(gap, TICK_NS)
    if gap > rule["gap_max_ns"]:
        return note(memory, STATE_GAP, WHOLE_ARM, gap * S, rule["gap_max_ns"] * S)
    if memory["stale_ns"] > rule["gap_max_ns"]:
        return note(memory, STATE_AGE, WHOLE_ARM, memory["stale_ns"] * S, rule["gap_max_ns"] * S)
    if other["silent_ns"] > rule["skew_max_ns"]:
        return note(memory, PAIR_SKEW, WHOLE_ARM, other["silent_ns"] * S, rule["skew_max_ns"] * S)
    return 0


@compiled
def find_not_finite(sample, residual, memory):
    """Return NOT_FINITE where a value that is used is not, else 0."""
    for i in range(7):
        total = sample["q"][i] + sample["dq"][i] + sample["tau_J"][i] + sample["tau_ext_hat_filtered"][i]
        if not math.isfinite(total + sample["tau_desired"][i] + residual[i]):
            return note(memory, NOT_FINITE, i, math.nan, 0.0)
    total = 0.0
    for i in range(6):
        total += sample["O_F_ext_hat_K"][i]
    for i in range(4):
        for j in range(4):
            total += sample["O_T_EE"][i, j]
    if not math.isfinite(total):
        return note(memory, NOT_FINITE, WHOLE_ARM, math.nan, 0.0)
    return 0


@compiled
def find_joint(sample, residual, rule, memory):
    """Return the first reason to stop that a joint of a finite state gives, or the pad's force, else 0."""
    phase = memory["phase"]
    for i in range(7):
        q, dq = sample["q"][i], sample["dq"][i]
        lower, upper = rule["q_lower"][i], rule["q_upper"][i]
        # where a stop that begins now would end
        travel = dq * rule["reaction"] + dq * abs(dq) / (2.0 * rule["braking"][i])
        if q + max(travel, 0.0) > upper:
            return note(memory, JOINT_POSITION, i, q + max(travel, 0.0), upper)
        if q + min(travel, 0.0) < lower:
            return note(memory, JOINT_POSITION, i, q + min(travel, 0.0), lower)
        # the velocity law of the arm, see hal.limits
        room = upper - q if dq > 0.0 else q - lower
        fastest = math.sqrt(2.0 * rule["deceleration"][i] * room) - rule["velocity_offset"][i]
        fastest = min(rule["dq_max"][i], max(0.0, fastest))
        if abs(dq) > fastest:
            return note(memory, JOINT_VELOCITY, i, dq, fastest)
        if abs(sample["tau_J"][i]) > rule["tau_J_max"][i]:
            return note(memory, MEASURED_TORQUE, i, sample["tau_J"][i], rule["tau_J_max"][i])
        if abs(sample["tau_ext_hat_filtered"][i]) > rule["tau_ext_max"][phase, i]:
            return note(memory, EXTERNAL_TORQUE, i, sample["tau_ext_hat_filtered"][i], rule["tau_ext_max"][phase, i])
        if abs(residual[i]) > rule["tau_ext_max"][phase, i]:
            return note(memory, RESIDUAL, i, residual[i], rule["tau_ext_max"][phase, i])
    x, y, z = sample["O_F_ext_hat_K"][0], sample["O_F_ext_hat_K"][1], sample["O_F_ext_hat_K"][2]
    force = math.sqrt(x * x + y * y + z * z)
    if force > rule["force_max"][phase]:
        return note(memory, FORCE, WHOLE_ARM, force, rule["force_max"][phase])
    return 0


@compiled
def find_arm(sample, other, rule, memory):
    """Return the first reason to stop that the arm as a whole gives, where it was placed, else 0."""
    for a in range(3):
        place = memory["face_world"][a]
        if place < rule["ee_lower"][a]:
            return note(memory, WORKSPACE, WHOLE_ARM, place, rule["ee_lower"][a])
        if place > rule["ee_upper"][a]:
            return note(memory, WORKSPACE, WHOLE_ARM, place, rule["ee_upper"][a])
    x, y, z = memory["face_velocity"]
    speed = math.sqrt(x * x + y * y + z * z)
    if speed > rule["ee_speed_max"]:
        return note(memory, SPEED, WHOLE_ARM, speed, rule["ee_speed_max"])
    power = 0.0
    for i in range(7):
        power += sample["tau_J"][i] * sample["dq"][i]
    if abs(power) > rule["power_max"]:
        return note(memory, POWER, WHOLE_ARM, power, rule["power_max"])
    if other["placed"] != 0:
        distance = arm_distance(memory, other, rule, rule["arm_distance_min"])
        if distance < rule["arm_distance_min"]:
            return note(memory, ARM_DISTANCE, WHOLE_ARM, distance, rule["arm_distance_min"])
    return 0
