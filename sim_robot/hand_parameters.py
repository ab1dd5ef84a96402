"""The Franka Hand that a scene may mount on an arm's flange, by its published numbers.

Sources: what Desk sets for the hand (mass, centre, inertia, end effector); its manual (travel, speed, force);
franka_description (where the fingers begin).
"""

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from hal.base.configuration import Positive
from sim_robot.plant_parameters import Vector3, Vector3Positive

TURN_RAD = -pi / 4.0  # of the hand about the flange's z
# the fingers move along the hand's y axis, here in the flange's frame
FINGER_AXIS: Vector3 = (-sin(TURN_RAD), cos(TURN_RAD), 0.0)
FINGER_BASE_Z = 0.0584  # m, where the fingers begin, from the flange
PALM_SIZE: Vector3 = (0.063, 0.204, FINGER_BASE_Z)  # m, the outline as a box
# m: a finger as a box, 20 mm broad and 15 mm thick, up to its tip. Ours: the vendor's fingers are exchangeable
FINGER_SIZE: Vector3 = (0.02, 0.015, 0.054)


@dataclass(frozen=True, slots=True)
class FrankaHand:
    """A hand on the flange. SI units; centre and inertia (diagonal, about the centre) in the flange's frame.

    tip_offset_z: from the flange to the middle of the closed fingertips, the end effector. max_width: between the open
    fingers; max_speed: of the width; max_force: of a finger, for any time (for a moment the hand has 140 N). stiffness
    N/m and friction are of a fingertip on an object, and ours. move_timeout_s: a move that is blocked ends after it, as
    users of the robot report; homing_speed and start_width, how a switched-on hand stands, are ours.
    """

    mass: Positive = 0.73
    centre: Vector3 = (-0.01, 0.0, 0.03)
    inertia: Vector3Positive = (0.001, 0.0025, 0.0017)
    tip_offset_z: Positive = 0.1034
    max_width: Positive = 0.08
    max_speed: Positive = 0.1
    max_force: Positive = 70.0
    stiffness: Positive = 4e5
    friction: Positive = 0.9
    homing_speed: Positive = 0.05
    move_timeout_s: Positive = 100.0
    start_width: Positive = 0.06

    def __post_init__(self) -> None:
        if self.start_width > self.max_width:
            raise ValueError(f"start_width must not exceed max_width, {self.max_width}, got {self.start_width}")

    def F_T_NE(self) -> NDArray[np.float64]:
        """Return the end effector in the flange's frame, (4, 4), row-major."""
        T = np.eye(4)
        c, s = cos(TURN_RAD), sin(TURN_RAD)
        T[:2, :2], T[2, 3] = ((c, -s), (s, c)), self.tip_offset_z
        return T

    def finger_position(self, finger: int, width: float) -> NDArray[np.float64]:
        """Return the middle of finger 0 or 1 in the flange's frame, (3,) m, at a width, m."""
        out = (width + FINGER_SIZE[1]) / 2.0
        z = FINGER_BASE_Z + FINGER_SIZE[2] / 2.0
        return (1.0 - 2.0 * finger) * out * np.array(FINGER_AXIS) + (0.0, 0.0, z)
