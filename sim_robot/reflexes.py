"""The basic reflexes: what the vendor's controller refuses, as masks of hal.robot_errors. Pure functions.

They judge what the robot can know: the command it was sent and the state it measured.
"""

from collections.abc import Callable
from math import sqrt

import numba
import numpy as np
from numpy.typing import NDArray

from hal.compilation import bound
from hal.limits import CONTROL_PERIOD_S, FR3
from hal.robot_errors import error_bit
from sim_robot.arm_description import JOINTS
from sim_robot.plant_parameters import ReflexParameters

Array = NDArray[np.float64]

TORQUE_DISCONTINUITY = error_bit("controller_torque_discontinuity")
COMMUNICATION = error_bit("communication_constraints_violation")
POSITION_LIMITS = error_bit("joint_position_limits_violation")
VELOCITY = error_bit("joint_velocity_violation")
TORQUE_RANGE = error_bit("tau_j_range_violation")
# what the state alone can show, and what therefore can persist
STATE_ERRORS = POSITION_LIMITS | VELOCITY | TORQUE_RANGE

# the limit is met exactly by who limits the rate to it: rounding must not trip it
_LARGEST_STEP = FR3.tau_rate_max * CONTROL_PERIOD_S + 1e-6
_LIMITS = np.array([FR3.q_lower, FR3.q_upper, FR3.dq_max, FR3.velocity_offset, FR3.deceleration, FR3.tau_max])


@numba.njit(cache=True, error_model="numpy")
def _take(tau_last, largest, error, tau):
    for j in range(JOINTS):
        # written so that NaN is too large as well
        if not abs(tau[j] - tau_last[j]) <= largest:
            return error
    for j in range(JOINTS):
        tau_last[j] = tau[j]
    return 0


@numba.njit(cache=True, error_model="numpy")
def _judge(states, limits, overload, spare, position, velocity, torque, masks):
    any_mask = 0
    for arm in range(2):
        state, mask = states[arm], 0
        for j in range(JOINTS):
            q, dq = state.q[j], state.dq[j]
            if q < limits[0, j] or q > limits[1, j]:
                mask |= position
            above = sqrt(2.0 * limits[4, j] * max(limits[1, j] - q, 0.0)) - limits[3, j]
            below = sqrt(2.0 * limits[4, j] * max(q - limits[0, j], 0.0)) - limits[3, j]
            if dq - spare > min(limits[2, j], max(0.0, above)) or -dq - spare > min(limits[2, j], max(0.0, below)):
                mask |= velocity
            if abs(state.tau_J[j]) > overload * limits[5, j]:
                mask |= torque
        masks[arm] = mask
        any_mask |= mask
    return any_mask


def judge_of_commands(tau_last: Array) -> Callable[[Array], int]:
    """Return who judges the commands after the last one taken, (7,), Nm: 0, and it is the last one now, or the errors.

    A command that is not finite, or changes by more than 1000 Nm/s, is not taken.
    """
    return bound(_take, tau_last, _LARGEST_STEP, TORQUE_DISCONTINUITY, later=(np.zeros(JOINTS),))


def judge_of_states(
    states: NDArray[np.void], tolerances: ReflexParameters, masks: NDArray[np.int64]
) -> Callable[[], int]:
    """Return who judges both states (2,): the errors (position, velocity, torque beyond limits) go into masks (2,).

    It returns either's. The velocity limit shrinks to zero towards the position limits, as hal.limits says, and may be
    passed by `velocity_tolerance`. Torque trips at `tau_J_overload` times the range.
    """
    overload, spare = tolerances.tau_J_overload, tolerances.velocity_tolerance
    return bound(_judge, states, _LIMITS, overload, spare, POSITION_LIMITS, VELOCITY, TORQUE_RANGE, masks)
