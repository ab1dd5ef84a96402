"""The two records that the compiled judge works on: what it was given once (RULES), what it remembers (MEMORY)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.compilation import fields
from hal.limits import CONTROL_PERIOD_S
from rtstack.safety.body import BODY, CAPSULES, LINKS
from rtstack.safety.limits import RATE_FRACTION, ForcePhase, SafetyLimits

RULES = np.dtype(
    [
        *fields("f8", "q_lower q_upper dq_max velocity_offset deceleration tau_max tau_J_max", 7),
        ("tau_ext_max", "f8", (len(ForcePhase), 7)),
        ("force_max", "f8", len(ForcePhase)),
        *fields("f8", "braking stiffness damping", 7),
        *fields("f8", "reaction hold_share tau_step dt power_max ee_speed_max arm_distance_min"),
        *fields("f8", "ee_lower ee_upper", 3),
        *fields("i8", "gap_max_ns skew_max_ns"),
        *[(name, *kind) for name, *kind in BODY.descr],
        # of the other arm
        ("other_capsules", "i8"),
        *fields("f8", "other_radius other_reach", CAPSULES),
    ]
)

# one record an arm; of a pair, each judge sees the other's. joint: -1 where a finding is of the whole arm; value and
# bound: what was found. silent_ns: how long the other arm has gone on without a new state of this one.
MEMORY = np.dtype(
    [
        *fields("f8", "tau_applied tau_hold q_hold dq_hold", 7),
        # phase: a ForcePhase, which the session writes; limited: ticks in a row
        *fields("i8", "phase stopping reason limited joint"),
        *fields("f8", "value bound"),
        # the last state: its stamp; seen 1 after the first state, 2 when its clock has moved; how long nothing changed
        *fields("i8", "t_ns seen stale_ns silent_ns"),
        *fields("f8", "q dq tau_J", 7),
        # where the arm is: the pad's face m and m/s, the capsules' axes, the joints' axes and origins, in the world
        ("placed", "i8"),
        *fields("f8", "face_world face_velocity place", 3),
        ("ends_world", "f8", (CAPSULES, 2, 3)),
        *fields("f8", "axes origins", 7, 3),
        *fields("f8", "turn next", 3, 3),
    ]
)


@dataclass(frozen=True, slots=True)
class StopProfile:
    """How a stop brakes, by SafetyLimits.braking, then holds. reaction_s: until the first braking torque."""

    reaction_s: float = 2e-3
    # stiff enough to stay; the wrist damped critically with the smallest inertia that it can have (B_theta 0.067 and a
    # link of some 0.02 kg m^2). Shoulder and elbow between what rings on (20) and what excites the joints' elasticity:
    # at 50, arms that were stopped in an impact swung at 51 Hz for ever, at 35 and below they did not. Nm/rad, Nms/rad
    stiffness: tuple[float, ...] = (600.0, 600.0, 600.0, 600.0, 100.0, 80.0, 40.0)
    damping: tuple[float, ...] = (30.0, 30.0, 30.0, 30.0, 6.0, 5.5, 4.0)
    # the torque that is held through a stop is the mean of about this long
    average_s: float = 0.02


def rules(
    limits: SafetyLimits, profile: StopProfile, body: NDArray[np.void], other: NDArray[np.void] | None = None
) -> NDArray[np.void]:
    """Return the RULES (1,), read-only. body, other: of this arm and of the other one, by default the same."""
    record = np.zeros(1, RULES)
    rule = record[0]
    for name in ("q_lower", "q_upper", "dq_max", "tau_max", "tau_J_max"):
        rule[name] = getattr(limits, name)
    for name in ("power_max", "ee_lower", "ee_upper", "ee_speed_max", "arm_distance_min"):
        rule[name] = getattr(limits, name)
    rule["tau_ext_max"], rule["force_max"] = limits.tau_ext_by_phase, limits.force_by_phase
    rule["velocity_offset"], rule["deceleration"] = limits.arm.velocity_offset, limits.arm.deceleration
    rule["braking"] = limits.braking
    rule["stiffness"], rule["damping"], rule["reaction"] = profile.stiffness, profile.damping, profile.reaction_s
    rule["hold_share"], rule["dt"] = CONTROL_PERIOD_S / profile.average_s, CONTROL_PERIOD_S
    rule["tau_step"] = limits.tau_rate_max * CONTROL_PERIOD_S * RATE_FRACTION
    rule["gap_max_ns"], rule["skew_max_ns"] = round(limits.state_gap_max_s * 1e9), round(limits.pair_skew_max_s * 1e9)
    for name in BODY.names or ():
        rule[name] = body[name]
    other = body if other is None else other
    rule["other_capsules"], rule["other_radius"] = other["first"][LINKS], other["radius"]
    rule["other_reach"] = other["reach"]
    record.flags.writeable = False
    return record


def empty_memory(arms: int) -> NDArray[np.void]:
    """Return the MEMORY (arms,) of judges that have seen nothing."""
    return np.zeros(arms, MEMORY)
