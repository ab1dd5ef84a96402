"""The stop: each joint's velocity goes to zero at its braking around a torque that holds what was held; then stays."""

import math

from hal.compilation import compiled
from rtstack.safety.checks import note
from rtstack.safety.reasons import Cause

TORQUE, TORQUE_RATE = int(Cause.TORQUE), int(Cause.TORQUE_RATE)


@compiled
def begin_stop(sample, memory, reason):
    """Latch a stop that begins where the arm is, or, joint by joint, where it was last seen."""
    memory["stopping"] = 1
    memory["reason"] = reason
    for i in range(7):
        if math.isfinite(sample["q"][i]):
            memory["q_hold"][i] = sample["q"][i]
        elif memory["placed"] == 0:
            memory["q_hold"][i] = math.nan  # it was never seen: hold the first place that it shows
        if math.isfinite(sample["dq"][i]):
            memory["dq_hold"][i] = sample["dq"][i]


@compiled
def braking_torque(sample, rule, memory):
    """Write the torque of the braking profile to tau_applied; a value that is not finite counts as no error.

    The profile ends at a position limit at the latest, and an arm that is beyond one is not pulled back.
    """
    for i in range(7):
        slower = max(0.0, abs(memory["dq_hold"][i]) - rule["braking"][i] * rule["dt"])
        velocity = math.copysign(slower, memory["dq_hold"][i])
        if math.isnan(memory["q_hold"][i]):
            memory["q_hold"][i] = sample["q"][i]
        place = memory["q_hold"][i]
        following = place + velocity * rule["dt"]
        furthest, nearest = max(place, rule["q_upper"][i]), min(place, rule["q_lower"][i])
        if following > furthest or following < nearest:
            following = min(max(following, nearest), furthest)
            velocity = 0.0
        memory["q_hold"][i] = following
        memory["dq_hold"][i] = velocity
        tau = memory["tau_hold"][i]
        spring = rule["stiffness"][i] * (following - sample["q"][i])
        damper = rule["damping"][i] * (velocity - sample["dq"][i])
        if math.isfinite(spring):
            tau += spring
        if math.isfinite(damper):
            tau += damper
        sample["tau_applied"][i] = tau


@compiled
def clip(sample, rule, memory, wanted):
    """Bring `wanted` (7,) inside torque and torque rate, write it to tau_applied; return the reason for a change.

    The torque's bound comes first, even where the robot says that it was commanded more.
    """
    reason = 0
    for i in range(7):
        tau = wanted[i]
        bound = rule["tau_max"][i]
        if abs(tau) > bound:
            reason = note(memory, TORQUE, i, tau, bound)
            tau = min(max(tau, -bound), bound)
        last = min(max(memory["tau_applied"][i], -bound), bound)
        lowest, highest = last - rule["tau_step"], last + rule["tau_step"]
        if tau < lowest or tau > highest:
            if reason == 0:
                reason = note(memory, TORQUE_RATE, i, tau - last, rule["tau_step"])
            tau = min(max(tau, lowest), highest)
        sample["tau_applied"][i] = tau
    return reason
