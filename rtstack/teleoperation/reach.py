"""What an operator may ask for: where, how far ahead, how fast, how hard. Robot process and console share it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rtstack.safety.limits import CONTROL_PAD_SPEED_FRACTION, SafetyLimits

SLOWEST_M_S, FASTEST_M_S, SPEED_M_S = 0.05, 0.4, 0.2
TURN_RAD_M = 2.5  # of the speed: an end effector at 0.4 m/s turns at 1 rad/s at most
SOFTEST_N_M, HARDEST_N_M, STIFFNESS_N_M = 100.0, 600.0, 300.0  # the last one: K_r of the reference-spreading paper
AHEAD_M, AHEAD_RAD = 0.25, 0.8  # of the command: what is further away is a jump, and is not followed
TILT_RAD = 1.0  # away from where the end effector began
# of the judge's box, at whose edge it stops the arms: at 300 N/m they swing past their command by up to 15 mm. Below
# there is less, since at home the pads are only 10 mm above the box's floor
INSIDE_M, INSIDE_FLOOR_M = 0.03, 0.01
UNIT_TOLERANCE = 1e-3  # of a quaternion's length
GAP_M = 0.04  # between both pads' faces along y, so that empty hands do not clap


@dataclass(frozen=True, slots=True)
class Reach:
    """The box that requests are kept in: lower and upper (3,), m, of the middle of the pad's face in the world.

    fastest_m_s: of the pad.
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    fastest_m_s: float = FASTEST_M_S

    @classmethod
    def within(cls, limits: SafetyLimits) -> "Reach":
        """Return the judge's box and speed, a margin inside."""
        fastest = min(FASTEST_M_S, CONTROL_PAD_SPEED_FRACTION * limits.ee_speed_max)
        below = (INSIDE_M, INSIDE_M, INSIDE_FLOOR_M)
        return cls(np.array(limits.ee_lower) + below, np.array(limits.ee_upper) - INSIDE_M, fastest)
