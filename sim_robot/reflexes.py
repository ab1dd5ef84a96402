"""The basic reflexes: what the vendor's controller refuses of commands and measured states, by hal.robot_errors."""

from collections.abc import Callable
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from hal.base.arrays import Array
from hal.compilation import bound, compiled
from hal.limits import CONTROL_PERIOD_S, ArmLimits
from hal.robot_errors import error_bit
from hal.robots import RobotModel
from sim_robot.arm_description import JOINTS
from sim_robot.plant_parameters import ReflexParameters

TORQUE_DISCONTINUITY = error_bit("controller_torque_discontinuity")
COMMUNICATION = error_bit("communication_constraints_violation")
POSITION_LIMITS = error_bit("joint_position_limits_violation")
VELOCITY = error_bit("joint_velocity_violation")
TORQUE_RANGE = error_bit("tau_j_range_violation")
CARTESIAN_POSITION = error_bit("cartesian_position_limits_violation")
CARTESIAN_VELOCITY = error_bit("cartesian_velocity_violation")
POWER = error_bit("power_limit_violation")
INSTABILITY = error_bit("instability_detected")
WRONG_DIRECTION = error_bit("joint_move_in_wrong_direction")
# after the error of a position limit, further out than this a joint is pushed in the wrong direction, rad: farther than
# an arm comes that brakes
_FURTHER_OUT = 5e-3
_SWING_MEMORY_S = 0.1  # in this time what a joint's swings are counted with forgets them
_SWINGS_PER_HZ = 2.0 * _SWING_MEMORY_S  # the velocity reverses twice a period

JUDGED_RECORD = np.dtype(
    [
        ("swing_sign", "f8", JOINTS),  # of the last velocity beyond the threshold
        ("swings", "f8", JOINTS),  # how often it has changed, older ones counting less
        ("q_stopped", "f8", JOINTS),  # where a position limit's error came
        ("beyond", "i8"),  # 1: that error has not been cleared
    ]
)
_NUMBERS = ("overload", "velocity", "speed", "power", "swing_velocity", "swings")
_TOLERANCE_RECORD = np.dtype([*((name, "f8") for name in _NUMBERS), ("walls", "f8", (2, 3))])


@compiled
def _take(tau_last, largest, error, tau):
    for j in range(JOINTS):
        # written so that NaN is too large as well
        if not abs(tau[j] - tau_last[j]) <= largest:
            return error
    tau_last[:] = tau
    return 0


@compiled
def _judge(states, kinematics, judged, limits_of, tolerances, masks):
    any_mask = 0
    for arm in range(states.shape[0]):
        state, mask, body, memory = states[arm], 0, kinematics[arm], judged[arm]
        limits, tolerance = limits_of[arm], tolerances[arm]
        power, speed = 0.0, 0.0
        for j in range(JOINTS):
            q, dq = state.q[j], state.dq[j]
            beyond = q < limits[0, j] or q > limits[1, j]
            if beyond:
                mask |= POSITION_LIMITS
            above = sqrt(2.0 * limits[4, j] * max(limits[1, j] - q, 0.0)) - limits[3, j]
            below = sqrt(2.0 * limits[4, j] * max(q - limits[0, j], 0.0)) - limits[3, j]
            upper, lower = min(limits[2, j], max(0.0, above)), min(limits[2, j], max(0.0, below))
            if dq - tolerance.velocity > upper or -dq - tolerance.velocity > lower:
                mask |= VELOCITY
            if abs(state.tau_J[j]) > tolerance.overload * limits[5, j]:
                mask |= TORQUE_RANGE
            power += state.tau_J_d[j] * dq
            memory.swings[j] *= 1.0 - CONTROL_PERIOD_S / _SWING_MEMORY_S
            if abs(dq) > tolerance.swing_velocity:
                sign = 1.0 if dq > 0.0 else -1.0
                if memory.swing_sign[j] == -sign:
                    memory.swings[j] += 1.0
                memory.swing_sign[j] = sign
            if memory.swings[j] > tolerance.swings:
                mask |= INSTABILITY
            further = (q - memory.q_stopped[j]) * (1.0 if q > limits[1, j] else -1.0)
            if memory.beyond != 0 and beyond and further > _FURTHER_OUT:
                mask |= WRONG_DIRECTION
        if power > tolerance.power:
            mask |= POWER
        for r in range(3):
            velocity = 0.0
            for j in range(JOINTS):
                velocity += body.J[r, j] * state.dq[j]
            speed += velocity * velocity
            if not tolerance.walls[0, r] <= body.T[r, 3] <= tolerance.walls[1, r]:
                mask |= CARTESIAN_POSITION
        if speed > tolerance.speed * tolerance.speed:
            mask |= CARTESIAN_VELOCITY
        masks[arm] = mask
        any_mask |= mask
    return any_mask


def judge_of_commands(tau_last: Array, limits: ArmLimits) -> Callable[[Array], int]:
    """Return the judge of a command, (7,) Nm, after the last one taken: 0, and it is taken, or the error's mask."""
    # the limit is met exactly by who limits the rate to it: rounding must not trip it
    largest_step = limits.tau_rate_max * CONTROL_PERIOD_S + 1e-6
    return bound(_take, tau_last, largest_step, TORQUE_DISCONTINUITY, later=(np.zeros(JOINTS),))


def judge_of_states(
    states: NDArray[np.void], kinematics: NDArray[np.void], judged: NDArray[np.void], robots: tuple[RobotModel, ...],
    tolerances: ReflexParameters, masks: NDArray[np.int64],
) -> Callable[[], int]:  # fmt: skip
    """Return who judges the states (n,), once a ms: the errors go into masks (n,); it returns any arm's.

    kinematics: the sensors' KINEMATICS_RECORDs (n,); judged: JUDGED_RECORDs (n,), what is remembered from ms to ms. The
    velocity limit shrinks to zero towards the position limits where the robot itself enforces that (hal.limits).
    """
    record = np.zeros(len(robots), _TOLERANCE_RECORD)
    record["overload"], record["velocity"] = tolerances.tau_J_overload, tolerances.velocity_tolerance
    record["speed"] = [model.cartesian.translation[0] for model in robots]
    record["power"] = tolerances.largest_power
    record["swing_velocity"] = tolerances.swing_velocity
    record["swings"] = _SWINGS_PER_HZ * tolerances.swing_rate_hz
    record["walls"] = tolerances.walls_lower, tolerances.walls_upper
    every = [model.limits for model in robots]
    rows = [(own.q_lower, own.q_upper, own.dq_max, *own.enforced_velocity_law(), own.tau_max) for own in every]
    return bound(_judge, states, kinematics, judged, np.array(rows), record, masks)
