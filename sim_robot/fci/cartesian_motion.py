"""The generator of Cartesian motions: poses and twists, checked, and as joint positions. Compiled."""

from math import acos, cos, sin, sqrt

import numpy as np

from hal.compilation import compiled
from hal.robot_errors import error_bit
from sim_robot.arm_description import JOINTS
from sim_robot.fci.joint_motion import DT, SPARE, START, START_NOISE, TOLERATED, beyond, judge_joints, start_of
from sim_robot.fci.protocol import Generator
from sim_robot.fci.robot_state import product
from sim_robot.kinematics import cholesky, forward_kinematics, gram, solve

_IK_DAMPING = 1e-4


@compiled
def sine_between(A, B, w):
    """w (3,): along the axis of the turn from A to B, as long as its angle's sine; of B A^T - A B^T."""
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        total = 0.0
        for c in range(3):
            total += B[j, c] * A[i, c] - B[i, c] * A[j, c]
        w[k] = total / 2.0


@compiled
def rotation_between(A, B, w):
    """w (3,): the rotation vector from A to B, R_B = exp(w) R_A, along the base's axes."""
    trace = 0.0
    for r in range(3):
        for c in range(3):
            trace += A[r, c] * B[r, c]
    sine_between(A, B, w)
    s = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    angle = acos(max(-1.0, min(1.0, (trace - 1.0) / 2.0))) if s > 1e-4 else s
    for k in range(3):
        w[k] *= angle / s if s > 1e-12 else 1.0


@compiled
def step_between(A, B, step):
    """step (6,): from pose A to pose B, (4, 4) each, m and rad along the base's axes."""
    rotation_between(A, B, step[3:])
    step[:3] = B[:3, 3] - A[:3, 3]


@compiled
def turn(T, w, dt):
    """Turn and move T by the twist w (6,) for dt, along the base's axes."""
    T[:3, 3] += w[:3] * dt
    x, y, z = w[3] * dt, w[4] * dt, w[5] * dt
    angle = sqrt(x * x + y * y + z * z)
    if angle < 1e-15:
        return
    x, y, z = x / angle, y / angle, z / angle
    s, c = sin(angle), 1.0 - cos(angle)
    for k in range(3):
        a, b, d = T[0, k], T[1, k], T[2, k]
        u, v, e = y * d - z * b, z * a - x * d, x * b - y * a
        along = x * a + y * b + z * d
        T[0, k] = a + s * u + c * (x * along - a)
        T[1, k] = b + s * v + c * (y * along - b)
        T[2, k] = d + s * e + c * (z * along - d)


@compiled
def norm(v, first):
    return sqrt(v[first] * v[first] + v[first + 1] * v[first + 1] + v[first + 2] * v[first + 2])


@compiled
def inverse_step(body, setting, T_goal, elbow, with_elbow, q):
    """Move q (7,) towards the pose T_goal of the end effector by one damped Newton step.

    Without an elbow the smallest motion, with one joint 3 goes where the elbow says and the others make up for it.
    """
    T, error = np.empty((4, 4)), np.empty(6)
    forward_kinematics(body, q)
    product(body.T, setting.face_T_EE, T)
    step_between(T, T_goal, error)
    # the Jacobian is that of the pad's face: move the error there
    lx, ly, lz = body.T[0, 3] - T[0, 3], body.T[1, 3] - T[1, 3], body.T[2, 3] - T[2, 3]
    error[0] += error[4] * lz - error[5] * ly
    error[1] += error[5] * lx - error[3] * lz
    error[2] += error[3] * ly - error[4] * lx
    J, step3 = body.J, elbow - q[2] if with_elbow else 0.0
    if with_elbow:
        error -= J[:, 2] * step3
        J[:, 2] = 0.0
    gram(J, body.JJ)
    if not cholesky(body.JJ, _IK_DAMPING * _IK_DAMPING, body.factor):
        return
    solve(body.factor, error)
    q[2] += step3
    for j in range(JOINTS):
        for r in range(6):
            q[j] += J[r, j] * error[r]


CARTESIAN_POSITION, CARTESIAN_VELOCITY = int(Generator.CARTESIAN_POSITION), int(Generator.CARTESIAN_VELOCITY)

_TRANSLATION, _ROTATION, _ELBOW = 0, 1, 2  # rows of cartesian_limits

CMG_START = error_bit("cartesian_position_motion_generator_start_pose_invalid")
CMG_FRAME = error_bit("cartesian_position_motion_generator_invalid_frame")
CMG_ELBOW = error_bit("cartesian_motion_generator_elbow_limit_violation")
CMG_ELBOW_SIGN = error_bit("cartesian_motion_generator_elbow_sign_inconsistent")
CMG_ELBOW_START = error_bit("cartesian_motion_generator_start_elbow_invalid")
CMG_VELOCITY = error_bit("cartesian_motion_generator_velocity_limits_violation")
CMG_VELOCITY_JUMP = error_bit("cartesian_motion_generator_velocity_discontinuity")
CMG_ACCELERATION_JUMP = error_bit("cartesian_motion_generator_acceleration_discontinuity")
CMG_JOINT_POSITION = error_bit("cartesian_motion_generator_joint_position_limits_violation")
CMG_JOINT_VELOCITY = error_bit("cartesian_motion_generator_joint_velocity_limits_violation")
CMG_JOINT_VELOCITY_JUMP = error_bit("cartesian_motion_generator_joint_velocity_discontinuity")
CMG_JOINT_ACCELERATION_JUMP = error_bit("cartesian_motion_generator_joint_acceleration_discontinuity")
_JOINT_ERRORS = (CMG_JOINT_POSITION, CMG_JOINT_VELOCITY, CMG_JOINT_VELOCITY_JUMP, CMG_JOINT_ACCELERATION_JUMP)


@compiled
def _invalid_frame(T):
    """True where T (4, 4) is no pose: NaN, not orthonormal, or a last row that is none."""
    for a in range(3):
        for b in range(3):
            dot = T[0, a] * T[0, b] + T[1, a] * T[1, b] + T[2, a] * T[2, b]
            if not abs(dot - (1.0 if a == b else 0.0)) <= 1e-4:
                return True
    return not (T[3, 0] == 0.0 and T[3, 1] == 0.0 and T[3, 2] == 0.0 and T[3, 3] == 1.0)


@compiled
def _step_to(T, motion, body, setting, q_measured, twist, q_start):
    """Write the step to T as twist (6,), m and rad, and in a first one where it starts, q_start (7,); return errors."""
    step_between(motion.O_T_EE_d, T, twist)
    if motion.first == 0:
        return 0
    mask, far = 0, max(norm(twist, 0), norm(twist, 3))
    T_measured, from_measured = np.empty((4, 4)), np.empty(6)
    forward_kinematics(body, q_measured)
    product(body.T, setting.face_T_EE, T_measured)
    step_between(T_measured, T, from_measured)
    if max(norm(from_measured, 0), norm(from_measured, 3)) < far:
        twist[:] = from_measured
        far = max(norm(twist, 0), norm(twist, 3))
        q_start[:] = q_measured
    if not far <= START:
        mask |= CMG_START
    if far <= START_NOISE:
        twist[:] = 0.0
    return mask


@compiled
def _judge_twist(twist, rate, jump, most):
    """Return the errors of a twist and its rates, (6,) each, linear and angular apart; most: cartesian_limits."""
    mask = 0
    if not (norm(twist, 0) <= SPARE * most[_TRANSLATION, 0] and norm(twist, 3) <= SPARE * most[_ROTATION, 0]):
        mask |= CMG_VELOCITY
    if not (norm(rate, 0) <= TOLERATED * most[_TRANSLATION, 1] and norm(rate, 3) <= TOLERATED * most[_ROTATION, 1]):
        mask |= CMG_VELOCITY_JUMP
    if not (norm(jump, 0) <= TOLERATED * most[_TRANSLATION, 2] and norm(jump, 3) <= TOLERATED * most[_ROTATION, 2]):
        mask |= CMG_ACCELERATION_JUMP
    return mask


@compiled
def _judge_elbow(motion, command, setting, start, delbow, ddelbow):
    """Return the errors of the commanded elbow, rad, that moves at delbow and ddelbow from `start`."""
    elbow, limits, most, mask = command.elbow_c[0], setting.joint_limits, setting.cartesian_limits, 0
    if motion.first != 0 and not abs(elbow - start) <= START:
        mask |= CMG_ELBOW_START
    if command.elbow_c[1] != motion.elbow_c[1]:
        mask |= CMG_ELBOW_SIGN
    if not (limits[0, 2] <= elbow <= limits[1, 2] and abs(delbow) <= SPARE * most[_ELBOW, 0]):
        mask |= CMG_ELBOW
    # the vendor has no name of its own for an elbow that jumps
    jump = abs(ddelbow - motion.ddelbow_c[0]) / DT
    if not (abs(ddelbow) <= TOLERATED * most[_ELBOW, 1] and jump <= TOLERATED * most[_ELBOW, 2]):
        mask |= CMG_ELBOW
    return mask


@compiled
def follow_cartesian(motion, command, kind, body, setting, q_measured):
    """Take a pose or a twist; return errors, and change nothing then. q_measured (7,): where it may start, too."""
    T, twist = np.empty((4, 4)), np.empty(6)
    q_start, elbow_start = motion.q_d.copy(), motion.elbow_c[0]
    mask = 0
    if kind == CARTESIAN_POSITION:
        T[:] = command.O_T_EE_c.reshape(4, 4).T  # column-major
        if _invalid_frame(T):
            return CMG_FRAME
        mask |= _step_to(T, motion, body, setting, q_measured, twist, q_start)
        twist /= DT
    else:
        twist[:], T[:] = command.O_dP_EE_c, motion.O_T_EE_d
        turn(T, twist, DT)
    rate = (twist - motion.O_dP_EE_c) / DT
    jump = (rate - motion.O_ddP_EE_c) / DT
    mask |= _judge_twist(twist, rate, jump, setting.cartesian_limits)
    with_elbow, elbow = command.valid_elbow != 0, command.elbow_c[0]
    delbow, ddelbow = 0.0, 0.0
    if with_elbow:
        if motion.first != 0:
            elbow_start = start_of(elbow, q_measured[2], elbow_start)
        delbow = (elbow - elbow_start) / DT
        ddelbow = (delbow - motion.delbow_c[0]) / DT
        mask |= _judge_elbow(motion, command, setting, elbow_start, delbow, ddelbow)
    if mask != 0:
        return mask
    q = q_start.copy()
    for _ in range(3):
        inverse_step(body, setting, T, elbow, with_elbow, q)
    if motion.first != 0 and kind == CARTESIAN_POSITION and norm(twist, 0) == 0.0 and norm(twist, 3) == 0.0:
        q_start[:] = q  # at rest where it is commanded, not a step from where it was read
    dq = (q - q_start) / DT
    ddq = (dq - motion.dq_d) / DT
    dddq = (ddq - motion.ddq_d) / DT
    mask |= judge_joints(q, dq, ddq, dddq, setting.joint_limits, _JOINT_ERRORS)
    if mask == 0:
        motion.first, motion.with_elbow = 0, with_elbow
        motion.beyond += beyond(ddq, dddq, setting.joint_limits)
        motion.O_T_EE_d[:], motion.O_T_EE_c[:] = T, T
        motion.O_dP_EE_d[:], motion.O_dP_EE_c[:], motion.O_ddP_EE_c[:] = twist, twist, rate
        motion.q_d[:], motion.dq_d[:], motion.ddq_d[:] = q, dq, ddq
        if with_elbow:
            motion.elbow_c[0], motion.delbow_c[0], motion.ddelbow_c[0] = elbow, delbow, ddelbow
        else:
            motion.elbow_c[0], motion.delbow_c[0], motion.ddelbow_c[0] = q[2], dq[2], ddq[2]
    return mask
