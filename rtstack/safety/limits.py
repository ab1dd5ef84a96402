"""The one order of limits: the vendor's, the judge's inside, the cell's inside those, the controller's inside all.

`hal.limits` has the vendor's. `hardware_limits` draws the judge's lines a margin inside; a table `[safety]` of a cell
or a trial may tighten them and never widen them; `control_limits` draws the controller's a margin inside what is left,
so that what it asks for at a limit of its own passes the judge. All margins stand here.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array, Seven, seven
from hal.compilation import fields as record_fields
from hal.limits import COLLISION_TORQUES, CONTROL_PERIOD_S, ArmLimits, CollisionBehaviour, HoldBounds, OwnLimits
from hal.robots import FR3, RobotModel

Three = tuple[float, float, float]

# the judge's inside the vendor's: the robot's own reflex trips at its limit; the rate's limit is a strict one, and the
# wire rounds to single precision
VELOCITY_FRACTION = 0.98
POSITION_MARGIN_RAD = 0.005
RATE_FRACTION = 1.0 - 1e-4
# the controller's inside the judge's. Velocity: as much again as between vendor and judge, at every place, also where
# the vendor's limit falls towards the end of a joint's range; at most half of what a cell leaves. While the torque's
# rate is limited and the joints swing, a joint exceeds its own line by up to a third of it (test_binding_limits.py)
CONTROL_VELOCITY_MARGIN = 1.0 - VELOCITY_FRACTION  # of the vendor's dq_max
LARGEST_VELOCITY_SHARE = 0.5
CONTROL_TORQUE_FRACTION = 0.999  # the solver's answers are exact to 1e-4 Nm
CONTROL_MEASURED_FRACTION = 0.9  # the measured torque swings about the commanded one, as a plan counts on, too
CONTROL_RATE_FRACTION = 1.0 - 2e-4
CONTROL_PAD_SPEED_FRACTION = 0.8  # ours: the arms swing about their command
# how fast a joint comes to a line: its distance from the line falls with this time constant at most. A torque that
# falls by 1000 Nm/s keeps up where the acceleration that ends takes up to 40 Nm; at 0.01 s the plant's joints swing
APPROACH_S = 0.02
# of a joint's braking: how much of what pushes it from outside is countered at a line. Pads that squeeze an object with
# 100 N push joint 2 with 14 rad/s^2
PUSH_SHARE = 2.0
LARGEST_GAP_S = 0.02  # source FCI: 20 packets lost in a row abort the motion
SAME = 1e-4  # rad, rad/s, Nm: a file rounds
SMALLEST_DISTANCE_M = 0.02  # ours: between the capsules of the two arms
# What may be felt by phase, where a cell's file says nothing else. Approach: torques of the vendor's examples
# (libfranka, generate_joint_position_motion.cpp); 50 N with which the robot's own line, REFLEX_SHARE further out, is at
# the 65 N that are the smallest quasi-static value of ISO/TS 15066:2016, Table A.2 (face). Contact: 140 N, hand and
# chest in the same table, and as much at joints 1 to 4 as 116 N, the hardest hit of a demonstration, give there
CONTACT_FORCE_N = 140.0
FORCES_BY_PHASE = {
    "tau_ext_approach_max": (20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0),
    "force_approach_max": 50.0,
    "tau_ext_contact_max": (60.0, 60.0, 60.0, 60.0, 30.0, 30.0, 30.0),
    "force_contact_max": CONTACT_FORCE_N,
}
REFLEX_SHARE = 1.3  # of the judge's bound: the robot's threshold, so that the judge, whose stop is softer, comes first


class ForcePhase(IntEnum):
    """What the pads are about to do, and with that how hard they may push: a row of SafetyLimits.tau_ext_by_phase.

    IMPACT: what follows the impact of a trial. CONTACT: contact on purpose: motion by hand, demonstrations, a load that
    is put down, a trial that awaits its impact. APPROACH: nothing is to be met.
    """

    IMPACT = 0
    CONTACT = 1
    APPROACH = 2


class LimitWidened(ValueError):
    """A limit that cannot be taken. The message names the key, the value and the bound."""


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """The limits of the judge of one arm. Joints (7,); the box is of the pad's face in the world's frame.

    Names that end in lower or min bound from below, upper and max from above. tau_J_max bounds the measured torque (it
    swings above the command after an impact), tau_ext_max both the robot's estimate of the external torque and the
    controller's momentum residual, force_max the size of the robot's estimate of the pad's force; those with contact or
    approach in their name bound the same in these phases (ForcePhase), where they are smaller. power_max bounds the sum
    of |tau_J dq|'s balance, state_gap_max_s the robot's time between two states that differ, pair_skew_max_s the time
    for which one arm is answered without a new state of the other. arm: the model's own, for braking and the velocity
    limit near a position limit, which only a robot's own limits tighten (within_own).
    """

    q_lower: Seven
    q_upper: Seven
    dq_max: Seven
    tau_max: Seven
    tau_J_max: Seven
    tau_ext_max: Seven
    tau_rate_max: float
    power_max: float
    ee_speed_max: float
    force_max: float = CollisionBehaviour().collision_forces[0]
    tau_ext_contact_max: Seven = COLLISION_TORQUES
    force_contact_max: float = CollisionBehaviour().collision_forces[0]
    tau_ext_approach_max: Seven = COLLISION_TORQUES
    force_approach_max: float = CollisionBehaviour().collision_forces[0]
    ee_lower: Three = (-inf, -inf, -inf)
    ee_upper: Three = (inf, inf, inf)
    arm_distance_min: float = SMALLEST_DISTANCE_M
    state_gap_max_s: float = LARGEST_GAP_S
    pair_skew_max_s: float = LARGEST_GAP_S
    arm: ArmLimits = field(default=FR3.limits, repr=False, compare=False)

    @property
    def braking(self) -> Array:
        """What a joint brakes with, (7,), rad/s^2: the arm's acceleration limit, or the deceleration of its
        position-dependent velocity limit where that is larger: from inside it a joint comes to rest in its range."""
        return np.maximum(self.arm.ddq_max, self.arm.deceleration)

    @property
    def tau_ext_by_phase(self) -> Array:
        """The bounds (3, 7), Nm, of the external torque by ForcePhase; no phase is wider than the one before."""
        rows = (self.tau_ext_max, self.tau_ext_contact_max, self.tau_ext_approach_max)
        return np.minimum.accumulate(np.array(rows), axis=0)

    @property
    def force_by_phase(self) -> Array:
        """The bounds (3,), N, of the pad's force by ForcePhase; no phase is wider than the one before."""
        return np.minimum.accumulate(np.array((self.force_max, self.force_contact_max, self.force_approach_max)))

    def collisions(self, phase: ForcePhase) -> CollisionBehaviour:
        """Return the robot's own thresholds for a motion of this phase: REFLEX_SHARE further out than the judge's, and
        never beyond those of an impact. With them the judge's bounds themselves, for an arm that is held meanwhile."""
        widest = CollisionBehaviour()
        torques = np.minimum(REFLEX_SHARE * self.tau_ext_by_phase[phase], widest.collision_torques)
        force = min(REFLEX_SHARE * float(self.force_by_phase[phase]), widest.collision_forces[0])
        moment = min(force, widest.collision_forces[3])  # Nm: that of the force at an arm of 1 m
        return CollisionBehaviour(
            contact_torques=tuple(np.minimum(widest.contact_torques, torques).tolist()),
            collision_torques=tuple(torques.tolist()),
            contact_forces=tuple(np.minimum(widest.contact_forces, force).tolist()),
            collision_forces=(force,) * 3 + (moment,) * 3,
            hold=HoldBounds(
                self.q_lower, self.q_upper, self.dq_max, seven(self.tau_ext_by_phase[phase]),
                float(self.force_by_phase[phase]),
            ),
        )  # fmt: skip

    def dq_upper(self, q: Array) -> Array:
        """Return the largest velocity allowed at q (..., 7), rad/s."""
        return self._fastest(np.asarray(self.q_upper) - q)

    def dq_lower(self, q: Array) -> Array:
        """Return the smallest (most negative) velocity allowed at q (..., 7), rad/s."""
        return -self._fastest(q - np.asarray(self.q_lower))

    def _fastest(self, room: Array) -> Array:
        """The arm's velocity limit near a position limit, see hal.limits."""
        braked = np.sqrt(2.0 * self.arm.deceleration * np.maximum(room, 0.0)) - self.arm.velocity_offset
        return np.minimum(self.dq_max, np.maximum(0.0, braked))

    def tightened(self, table: Mapping[str, Any]) -> "SafetyLimits":
        """Return these limits with those of `table` in their place. Raises LimitWidened with the first bad key."""
        for key, value in table.items():
            if key not in NAMES:
                raise LimitWidened(f"safety.{key}: no such limit; there are {', '.join(sorted(NAMES))}")
            _check(key, value, getattr(self, key))
        taken = {key: tuple(map(float, v)) if isinstance(v, list | tuple) else float(v) for key, v in table.items()}
        limits = replace(self, **taken)
        # each line of the controller's has to leave room for the other one
        room = 2.0 * (limits.arm.velocity_offset + control_margin(limits)) ** 2 / (2.0 * limits.arm.deceleration)
        for low, high, least in (("q_lower", "q_upper", room), ("ee_lower", "ee_upper", np.zeros(3))):
            if not np.all(np.subtract(getattr(limits, high), getattr(limits, low)) > least):
                raise LimitWidened(f"safety.{low}: {list(getattr(limits, low))} leaves no room below {high}")
        return limits


# of the limits, as a table `[safety]` spells them
NAMES = tuple(field.name for field in fields(SafetyLimits) if field.name != "arm")

PairLimits = tuple[SafetyLimits, ...]  # of each arm, left before right


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


def hardware_limits(robot: RobotModel = FR3) -> SafetyLimits:
    """Return the widest limits of an arm: its model's own, a margin inside. No power exceeds tau_max dq_max."""
    arm = robot.limits

    return SafetyLimits(
        q_lower=seven(arm.q_lower + POSITION_MARGIN_RAD),
        q_upper=seven(arm.q_upper - POSITION_MARGIN_RAD),
        dq_max=seven(arm.dq_max * VELOCITY_FRACTION),
        tau_max=seven(arm.tau_max),
        tau_J_max=seven(arm.tau_max),
        tau_ext_max=COLLISION_TORQUES,
        tau_rate_max=float(arm.tau_rate_max),
        power_max=float(arm.tau_max @ arm.dq_max),
        ee_speed_max=robot.cartesian.translation[0],
        arm=arm,
    )


# The controller's lines, as its compiled code takes them; joints (7,). Towards a position limit that is `room` away a
# joint goes at most at min(dq_max, sqrt(2 deceleration room) - velocity_offset), and brakes with `braking` at most.
# push_max: what is countered of an external acceleration. tau_max: of the commanded torque, tau_J_max: with gravity
# (the measured one), tau_step: Nm a tick
CONTROL_LIMITS = np.dtype(
    [
        *record_fields("f8", "q_lower q_upper dq_max velocity_offset deceleration braking", 7),
        *record_fields("f8", "tau_max tau_J_max push_max", 7),
        *record_fields("f8", "tau_step approach_s"),
    ]
)
"""What a controller may ask for, inside the judge's limits: q_lower, q_upper (7,) rad, dq_max rad/s, torques tau_max,
tau_J_max (with gravity's) and push_max Nm, tau_step Nm a tick, approach_s s."""


def control_margin(limits: SafetyLimits) -> Array:
    """Return how far inside the judge's velocity limits the controller's are, (7,), rad/s."""
    return np.minimum(CONTROL_VELOCITY_MARGIN * limits.arm.dq_max, LARGEST_VELOCITY_SHARE * np.asarray(limits.dq_max))


def control_limits(limits: SafetyLimits, period_s: float = CONTROL_PERIOD_S) -> NDArray[np.void]:
    """Return the controller's CONTROL_LIMITS (1,) inside the judge's `limits`."""
    record, margin = np.zeros(1, CONTROL_LIMITS), control_margin(limits)
    table = record[0]
    table["q_lower"], table["q_upper"] = limits.q_lower, limits.q_upper
    table["dq_max"], table["velocity_offset"] = limits.dq_max - margin, limits.arm.velocity_offset + margin
    table["deceleration"] = limits.arm.deceleration
    table["braking"], table["push_max"] = limits.braking, PUSH_SHARE * limits.braking
    table["tau_max"] = CONTROL_TORQUE_FRACTION * np.asarray(limits.tau_max)
    table["tau_J_max"] = CONTROL_MEASURED_FRACTION * np.asarray(limits.tau_J_max)
    table["tau_step"] = limits.tau_rate_max * period_s * CONTROL_RATE_FRACTION
    table["approach_s"] = APPROACH_S
    return record


def within_own(limits: SafetyLimits, own: OwnLimits) -> tuple[SafetyLimits, tuple[str, ...]]:
    """Return limits inside those that a robot says it has, the judge's margins inside, the tighter one of each; and in
    words what differs from the model's description, in both directions."""
    described = limits.arm
    differs = []
    for name, unit in (
        ("q_lower", "rad"), ("q_upper", "rad"), ("dq_max", "rad/s"), ("tau_max", "Nm"),
        ("velocity_offset", "rad/s"), ("deceleration", "rad/s^2"),
    ):  # fmt: skip
        if getattr(own, name) is None:
            continue
        for joint, (mine, its) in enumerate(zip(getattr(described, name), getattr(own, name), strict=True), 1):
            if abs(mine - its) > SAME:
                differs.append(f"{name} of joint {joint} is {its:g} {unit}, described as {mine:g}")
    if not differs:
        return limits, ()

    tau_max = np.minimum(limits.tau_max, own.tau_max)
    if own.velocity_offset is not None and own.deceleration is not None:
        described = replace(
            described,
            velocity_offset=np.maximum(described.velocity_offset, own.velocity_offset),
            deceleration=np.minimum(described.deceleration, own.deceleration),
        )
    inside = replace(
        limits,
        q_lower=seven(np.maximum(limits.q_lower, own.q_lower + POSITION_MARGIN_RAD)),
        q_upper=seven(np.minimum(limits.q_upper, own.q_upper - POSITION_MARGIN_RAD)),
        dq_max=seven(np.minimum(limits.dq_max, VELOCITY_FRACTION * own.dq_max)),
        tau_max=seven(tau_max),
        tau_J_max=seven(np.minimum(limits.tau_J_max, own.tau_max)),
        arm=described,
    )
    return inside, tuple(differs)


HARDWARE = hardware_limits()
