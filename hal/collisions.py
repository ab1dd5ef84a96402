"""How hard an arm may be touched before the robot itself says contact, or stops: what SetCollisionBehavior takes."""

from dataclasses import dataclass

from hal.limits import COLLISION_TORQUES


@dataclass(frozen=True, slots=True)
class CollisionBehaviour:
    """Thresholds of contact (flags only) and collision (reflex): joints (7,) Nm, pad (6,) N and Nm.

    By default those of a grab by impact, which must not be a collision: the vendor's examples stop at 20 N, which every
    wanted impact exceeds. A robot takes them between two motions only; what a phase of a motion may exert is the safety
    judge's (rtstack.safety.limits), and these are the line behind it.
    """

    contact_torques: tuple[float, ...] = (20.0, 20.0, 18.0, 18.0, 16.0, 14.0, 12.0)
    collision_torques: tuple[float, ...] = COLLISION_TORQUES
    contact_forces: tuple[float, ...] = (20.0, 20.0, 20.0, 25.0, 25.0, 25.0)
    collision_forces: tuple[float, ...] = (250.0, 250.0, 250.0, 80.0, 80.0, 80.0)
