"""Where the judge draws its lines: the hardware's limits, which a table `[safety]` may tighten and never widen."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import inf, isfinite
from typing import Any

from hal.limits import COLLISION_TORQUES, FR3, ArmLimits

Seven = tuple[float, float, float, float, float, float, float]
Three = tuple[float, float, float]

# the robot's own reflex trips at its limit: stay a little inside
VELOCITY_FRACTION = 0.98
POSITION_MARGIN_RAD = 0.005
LARGEST_SPEED_M_S = 3.0  # source: libfranka, rate_limiting.h, kMaxTranslationalVelocity
LARGEST_GAP_S = 0.02  # source FCI: 20 packets lost in a row abort the motion
SMALLEST_DISTANCE_M = 0.02  # ours: between the capsules of the two arms


class LimitWidened(ValueError):
    """A limit that cannot be taken. The message names the key, the value and the bound."""


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """The limits of the judge, the same for both arms. Joints (7,); the box is of the pad's face in the world's frame.

    Names that end in lower or min bound from below, upper and max from above. tau_J_max bounds the measured torque
    (it swings above the command after an impact), tau_ext_max both the robot's estimate of the external torque and the
    controller's momentum residual, power_max the sum of |tau_J dq|'s balance, state_gap_max_s the robot's time between
    two states that differ, pair_skew_max_s the time for which one arm is answered without a new state of the other.
    """

    q_lower: Seven
    q_upper: Seven
    dq_max: Seven
    tau_max: Seven
    tau_J_max: Seven
    tau_ext_max: Seven
    tau_rate_max: float
    power_max: float
    ee_lower: Three = (-inf, -inf, -inf)
    ee_upper: Three = (inf, inf, inf)
    ee_speed_max: float = LARGEST_SPEED_M_S
    arm_distance_min: float = SMALLEST_DISTANCE_M
    state_gap_max_s: float = LARGEST_GAP_S
    pair_skew_max_s: float = LARGEST_GAP_S

    def tightened(self, table: Mapping[str, Any]) -> "SafetyLimits":
        """Return these limits with those of `table` in their place. Raises LimitWidened with the first bad key."""
        known = {field.name for field in fields(self)}
        for key, value in table.items():
            if key not in known:
                raise LimitWidened(f"safety.{key}: no such limit; there are {', '.join(sorted(known))}")
            _check(key, value, getattr(self, key))
        taken = {key: tuple(map(float, v)) if isinstance(v, list | tuple) else float(v) for key, v in table.items()}
        limits = replace(self, **taken)
        for low, high in (("q_lower", "q_upper"), ("ee_lower", "ee_upper")):
            if not all(a < b for a, b in zip(getattr(limits, low), getattr(limits, high), strict=True)):
                raise LimitWidened(f"safety.{low}: {list(getattr(limits, low))} leaves no room below {high}")
        return limits


def _check(key: str, value: Any, bound: Any) -> None:
    """Raise LimitWidened unless `value` has the shape of `bound`, is finite, and lies on its safe side."""
    many = isinstance(bound, tuple)
    if many and (not isinstance(value, list | tuple) or len(value) != len(bound)):
        raise LimitWidened(f"safety.{key} = {value!r}: must be a list of {len(bound)} numbers")
    pairs = list(zip(value, bound, strict=True)) if many else [(value, bound)]
    for number, limit in pairs:
        if isinstance(number, bool) or not isinstance(number, int | float) or not isfinite(number):
            raise LimitWidened(f"safety.{key} = {value!r}: must be finite, a number")
        from_below = key.endswith(("lower", "min"))
        if number < limit if from_below else number > limit:
            side = "at least" if from_below else "at most"
            raise LimitWidened(f"safety.{key} = {value!r}: may only tighten, {number} must be {side} {limit}")
        if "_max" in key and number <= 0.0:
            raise LimitWidened(f"safety.{key} = {value!r}: must be positive, or nothing could ever pass")


def hardware_limits(arm: ArmLimits = FR3) -> SafetyLimits:
    """Return the widest limits that there are: the arm's own, a margin inside. No power exceeds tau_max dq_max."""

    def seven(values: Any) -> Seven:
        a, b, c, d, e, f, g = (float(v) for v in values)
        return a, b, c, d, e, f, g

    return SafetyLimits(
        q_lower=seven(arm.q_lower + POSITION_MARGIN_RAD),
        q_upper=seven(arm.q_upper - POSITION_MARGIN_RAD),
        dq_max=seven(arm.dq_max * VELOCITY_FRACTION),
        tau_max=seven(arm.tau_max),
        tau_J_max=seven(arm.tau_max),
        tau_ext_max=COLLISION_TORQUES,
        tau_rate_max=float(arm.tau_rate_max),
        power_max=float(arm.tau_max @ arm.dq_max),
    )


HARDWARE = hardware_limits()
