"""The generator of joint motions: positions and velocities that a client asks for, checked and followed. Compiled."""

from math import sqrt

import numpy as np

from hal.compilation import compiled
from hal.limits import CONTROL_PERIOD_S
from hal.robot_errors import error_bit
from sim_robot.arm_description import JOINTS
from sim_robot.fci.protocol import Generator

DT = CONTROL_PERIOD_S
JOINT_POSITION, JOINT_VELOCITY = int(Generator.JOINT_POSITION), int(Generator.JOINT_VELOCITY)

# a client that limits itself meets the velocity limits exactly: the states it starts from are float32
SPARE = 1.01
# The published accelerations and jerks bind the client; where the robot stops is not published. franky-control moves
# FR3s by the FER's limits, up to twice as high, and one step of 1e-5 rad stops an FR3 (franka_ros2, issue 55), which is
# 10 rad/s^2 and 1e4 rad/s^3, and 2e4 back. A robot that stops above twice the limits does all that. What is beyond the
# limits themselves is counted: motion.beyond.
TOLERATED = 2.02
# A motion starts where the arm is measured or where it is desired to be (since libfranka 0.15, system 5.7.2, examples
# begin at q and O_T_EE; before, at q_d and O_T_EE_c). How far the first command may be from the nearer of the two,
# m and rad, before it is a start pose that is invalid, and before it is a step: the vendor publishes no number. The
# second one is what two readings of an arm at rest differ by (plant.toml: the encoders' noise, and the wire's float32).
START, START_NOISE = 0.01, 2e-5
# how an asynchronous motion speeds up and brakes, rad/s^2: half of what a joint may, and softly at the end, 1/s
_ASYNCHRONOUS_ACCELERATION, _SETTLING = 5.0, 25.0
# a motion may end this fast, rad/s: the rest is braked by the controller
_END_VELOCITY = 0.1

VIA_PLANNING = error_bit("joint_via_motion_generator_planning_joint_limit_violation")
JMG_START = error_bit("joint_position_motion_generator_start_pose_invalid")
JMG_POSITION = error_bit("joint_motion_generator_position_limits_violation")
JMG_VELOCITY = error_bit("joint_motion_generator_velocity_limits_violation")
JMG_VELOCITY_JUMP = error_bit("joint_motion_generator_velocity_discontinuity")
JMG_ACCELERATION_JUMP = error_bit("joint_motion_generator_acceleration_discontinuity")
JOINT_ERRORS = (JMG_POSITION, JMG_VELOCITY, JMG_VELOCITY_JUMP, JMG_ACCELERATION_JUMP)


@compiled
def judge_joints(q, dq, ddq, dddq, L, errors):
    """Return a joint step's errors, (7,) each, NaN one of them. L: joint_limits; errors: bits by position ... jerk."""
    mask = 0
    for j in range(JOINTS):
        if not L[0, j] <= q[j] <= L[1, j]:
            mask |= errors[0]
        above = sqrt(2.0 * L[4, j] * max(L[1, j] - q[j], 0.0)) - L[3, j]
        below = sqrt(2.0 * L[4, j] * max(q[j] - L[0, j], 0.0)) - L[3, j]
        upper, lower = min(L[2, j], max(0.0, above)), min(L[2, j], max(0.0, below))
        # kLimitEps of rate_limiting.h
        if not -SPARE * lower - 1e-3 <= dq[j] <= SPARE * upper + 1e-3:
            mask |= errors[1]
        if not abs(ddq[j]) <= TOLERATED * L[5, j]:
            mask |= errors[2]
        if not abs(dddq[j]) <= TOLERATED * L[6, j]:
            mask |= errors[3]
    return mask


@compiled
def beyond(ddq, dddq, L):
    """True when a joint step, (7,) each, is beyond the published limits, with a spare for float32 states."""
    return (np.abs(ddq) > SPARE * L[5] + 0.5).any() or (np.abs(dddq) > SPARE * L[6] + 500.0).any()


@compiled
def start_of(commanded, measured, desired):
    """Return where a motion starts whose first command is this one: where it is commanded, unless that is a step."""
    start = measured if abs(commanded - measured) < abs(commanded - desired) else desired
    return commanded if abs(commanded - start) <= START_NOISE else start


@compiled
def follow_joints(motion, command, kind, setting, q_measured):
    """Take a position or velocity; return errors, and change nothing then. q_measured (7,): where a motion may start,
    too.
    """
    q, dq, ddq, dddq = np.empty(JOINTS), np.empty(JOINTS), np.empty(JOINTS), np.empty(JOINTS)
    mask = 0
    for j in range(JOINTS):
        if kind == JOINT_POSITION:
            q[j] = command.q_c[j]
            last = motion.q_d[j]
            if motion.first != 0:
                last = start_of(q[j], q_measured[j], last)
                if not abs(q[j] - last) <= START:
                    mask |= JMG_START
            dq[j] = (q[j] - last) / DT
        else:
            dq[j] = command.dq_c[j]
            q[j] = motion.q_d[j] + dq[j] * DT
        ddq[j] = (dq[j] - motion.dq_d[j]) / DT
        dddq[j] = (ddq[j] - motion.ddq_d[j]) / DT
    limits = setting.joint_limits
    mask |= judge_joints(q, dq, ddq, dddq, limits, JOINT_ERRORS)
    if mask == 0:
        motion.first = 0
        motion.beyond += beyond(ddq, dddq, limits)
        motion.q_d[:], motion.dq_d[:], motion.ddq_d[:] = q, dq, ddq
    return mask


@compiled
def take_target(motion, command, setting):
    """Take a target of an asynchronous motion; return the errors, and change nothing when there are any."""
    for j in range(JOINTS):
        if not setting.joint_limits[0, j] <= command.q_c[j] <= setting.joint_limits[1, j]:
            return VIA_PLANNING
    motion.target[:] = command.q_c
    return 0


@compiled
def approach_target(motion):
    """Go on for 1 ms towards the target of an asynchronous motion, every joint by itself."""
    largest_step = _ASYNCHRONOUS_ACCELERATION * DT
    for j in range(JOINTS):
        way = motion.target[j] - motion.q_d[j]
        # brakes at less than it may, since it notices each ms only
        wanted = min(motion.largest_velocity[j], sqrt(_ASYNCHRONOUS_ACCELERATION * abs(way)), _SETTLING * abs(way))
        wanted = wanted if way >= 0.0 else -wanted
        dq = motion.dq_d[j] + max(-largest_step, min(largest_step, wanted - motion.dq_d[j]))
        motion.ddq_d[j] = (dq - motion.dq_d[j]) / DT
        motion.dq_d[j] = dq
        motion.q_d[j] += dq * DT


@compiled
def ends_too_fast(motion):
    """True when a motion that ends now would end while it moves."""
    return (np.abs(motion.dq_d) > _END_VELOCITY).any()
