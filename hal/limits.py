"""What this stack is written for, 7 joints at 1 kHz; limits and thresholds of an arm. Numbers: hal/robots/*.toml."""

from dataclasses import dataclass, field
from math import inf

import numpy as np

from hal.base.arrays import Array

# The one place for both. Compiled records, the wire and the log have these sizes: an arm of another kind needs more
# than a description (docs/howto/robot.md)
DOF = 7
CONTROL_RATE_HZ = 1000  # FCI: one state and one command every millisecond
CONTROL_PERIOD_S = 1.0 / CONTROL_RATE_HZ

# An external torque that is a collision and no impact that was meant, Nm: what hal asks of the robot, and what the
# safety judge bounds. Ours: wanted impacts reach some 40 Nm at the base and 15 Nm at the wrist.
COLLISION_TORQUES = (100.0, 100.0, 100.0, 100.0, 60.0, 60.0, 60.0)


@dataclass(frozen=True, slots=True)
class HoldBounds:
    """Bounds outside of which an arm is not held without its judge (hal.fci.hold): joints (7,), rad, rad/s, Nm; the
    size of the pad's force, N. External torque and force are the robot's estimates."""

    q_lower: tuple[float, ...]
    q_upper: tuple[float, ...]
    dq_max: tuple[float, ...]
    tau_ext_max: tuple[float, ...]
    force_max: float


@dataclass(frozen=True, slots=True)
class CollisionBehaviour:
    """Thresholds of contact (flags only) and collision (reflex): joints (7,) Nm, pad (6,) N and Nm.

    By default those of a grab by impact, which must not be a collision: the vendor's examples stop at 20 N, which every
    wanted impact exceeds. A robot takes them between two motions only; what a phase of a motion may exert is the safety
    judge's (rtstack.safety.limits), and these are the line behind it.
    hold: the judge's bounds of the same motion; None: hold_bounds follow from the thresholds.
    """

    contact_torques: tuple[float, ...] = (20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0)
    collision_torques: tuple[float, ...] = COLLISION_TORQUES
    contact_forces: tuple[float, ...] = (20.0, 20.0, 20.0, 25.0, 25.0, 25.0)
    collision_forces: tuple[float, ...] = (250.0, 250.0, 250.0, 80.0, 80.0, 80.0)
    hold: HoldBounds | None = field(default=None, compare=False)

    @property
    def hold_bounds(self) -> HoldBounds:
        """Return where a hold ends: at the judge's bounds, or at these thresholds."""
        far, force = (inf,) * DOF, min(self.collision_forces[:3])
        return self.hold or HoldBounds((-inf,) * DOF, far, far, self.collision_torques, force)


@dataclass(frozen=True, slots=True, eq=False)
class OwnLimits:
    """Limits that a connected robot reports of its own joints: (7,), rad, rad/s, Nm.

    velocity_offset, rad/s, and deceleration, rad/s^2: of its velocity limit near a position limit (ArmLimits), None
    where it reports none.
    """

    q_lower: Array
    q_upper: Array
    dq_max: Array
    tau_max: Array
    velocity_offset: Array | None = None
    deceleration: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ArmLimits:
    """Limits of one arm. Arrays have shape (7,), SI units, and are read-only.

    The velocity limit depends on the position: close to a position limit q_upper,
    dq <= min(dq_max, max(0, sqrt(2 deceleration (q_upper - q)) - velocity_offset)), and likewise below.
    velocity_law_enforced: the robot itself stops beyond that line; otherwise it stops at dq_max alone, and the line is
    ours, inside which a joint can brake before its position limit.
    """

    q_lower: Array
    q_upper: Array
    dq_max: Array
    velocity_offset: Array
    deceleration: Array
    ddq_max: Array
    dddq_max: Array
    tau_max: Array
    tau_rate_max: float
    velocity_law_enforced: bool = True

    def dq_upper(self, q: Array) -> Array:
        """Largest allowed velocity at `q`, shape (7,), rad/s."""
        room = np.maximum(self.q_upper - q, 0.0)
        return np.minimum(self.dq_max, np.maximum(0.0, np.sqrt(2.0 * self.deceleration * room) - self.velocity_offset))

    def dq_lower(self, q: Array) -> Array:
        """Smallest (most negative) allowed velocity at `q`, shape (7,), rad/s."""
        room = np.maximum(q - self.q_lower, 0.0)
        return -np.minimum(self.dq_max, np.maximum(0.0, np.sqrt(2.0 * self.deceleration * room) - self.velocity_offset))

    def enforced_velocity_law(self) -> tuple[Array, Array]:
        """Return velocity_offset and deceleration, (7,), of the line at which the robot itself stops.

        Without a line of its own they are -dq_max and 0, with which the formula above is dq_max everywhere.
        """
        if self.velocity_law_enforced:
            return self.velocity_offset, self.deceleration
        return -self.dq_max, np.zeros(DOF)
