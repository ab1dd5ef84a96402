"""The robot's motion generators: what a client asks for, checked, and as joint positions. Compiled.

The limits are the model's (hal/robots), as the arm's settings hold them. What leaves them ends the motion with the
vendor's error; everything that is broken is named.
"""

from math import acos, cos, sin, sqrt

import numpy as np

from hal.compilation import compiled
from hal.limits import CONTROL_PERIOD_S
from hal.robot_errors import error_bit
from sim_robot.arm_description import JOINTS
from sim_robot.fci.protocol import Generator
from sim_robot.fci.robot_state import ELBOW_FLIP, product
from sim_robot.kinematics import cholesky, forward_kinematics, solve

DT = CONTROL_PERIOD_S
JOINT_POSITION, JOINT_VELOCITY = int(Generator.JOINT_POSITION), int(Generator.JOINT_VELOCITY)
CARTESIAN_POSITION, CARTESIAN_VELOCITY = int(Generator.CARTESIAN_POSITION), int(Generator.CARTESIAN_VELOCITY)

_TRANSLATION, _ROTATION, _ELBOW = 0, 1, 2  # rows of cartesian_limits
# a client that limits itself meets the velocity limits exactly: the states it starts from are float32
_SPARE = 1.01
# The published accelerations and jerks bind the client; where the robot stops is not published. franky-control moves
# FR3s by the FER's limits, up to twice as high, and one step of 1e-5 rad stops an FR3 (franka_ros2, issue 55), which is
# 10 rad/s^2 and 1e4 rad/s^3, and 2e4 back. A robot that stops above twice the limits does all that. What is beyond the
# limits themselves is counted: motion.beyond.
_TOLERATED = 2.02
# A motion starts where the arm is measured or where it is desired to be (since libfranka 0.15, system 5.7.2, examples
# begin at q and O_T_EE; before, at q_d and O_T_EE_c). How far the first command may be from the nearer of the two,
# m and rad, before it is a start pose that is invalid, and before it is a step: the vendor publishes no number. The
# second one is what two readings of an arm at rest differ by (plant.toml: the encoders' noise, and the wire's float32).
_START, _START_NOISE = 0.01, 2e-5
# how an asynchronous motion speeds up and brakes, rad/s^2: half of what a joint may, and softly at the end, 1/s
_ASYNCHRONOUS_ACCELERATION, _SETTLING = 5.0, 25.0
# a motion may end this fast, rad/s: the rest is braked by the controller
_END_VELOCITY = 0.1
_IK_DAMPING = 1e-4

VIA_PLANNING = error_bit("joint_via_motion_generator_planning_joint_limit_violation")
JMG_START = error_bit("joint_position_motion_generator_start_pose_invalid")
JMG_POSITION = error_bit("joint_motion_generator_position_limits_violation")
JMG_VELOCITY = error_bit("joint_motion_generator_velocity_limits_violation")
JMG_VELOCITY_JUMP = error_bit("joint_motion_generator_velocity_discontinuity")
JMG_ACCELERATION_JUMP = error_bit("joint_motion_generator_acceleration_discontinuity")
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


@compiled
def _judge_joints(q, dq, ddq, dddq, L, position, velocity, velocity_jump, acceleration_jump):
    """Errors of one joint step, (7,) each; L: the setting's joint_limits. Written so that NaN is an error."""
    mask = 0
    for j in range(JOINTS):
        if not L[0, j] <= q[j] <= L[1, j]:
            mask |= position
        above = sqrt(2.0 * L[4, j] * max(L[1, j] - q[j], 0.0)) - L[3, j]
        below = sqrt(2.0 * L[4, j] * max(q[j] - L[0, j], 0.0)) - L[3, j]
        upper, lower = min(L[2, j], max(0.0, above)), min(L[2, j], max(0.0, below))
        # kLimitEps of rate_limiting.h
        if not -_SPARE * lower - 1e-3 <= dq[j] <= _SPARE * upper + 1e-3:
            mask |= velocity
        if not abs(ddq[j]) <= _TOLERATED * L[5, j]:
            mask |= velocity_jump
        if not abs(dddq[j]) <= _TOLERATED * L[6, j]:
            mask |= acceleration_jump
    return mask


@compiled
def _beyond(ddq, dddq, L):
    """True when a joint step, (7,) each, is beyond the published limits, with a spare for float32 states."""
    for j in range(JOINTS):  # noqa: SIM110 - compiled
        if abs(ddq[j]) > _SPARE * L[5, j] + 0.5 or abs(dddq[j]) > _SPARE * L[6, j] + 500.0:
            return True
    return False


@compiled
def _rotation_between(A, B, w):
    """w (3,): the rotation vector from A to B, R_B = exp(w) R_A, along the base's axes."""
    trace = 0.0
    for r in range(3):
        for c in range(3):
            trace += A[r, c] * B[r, c]
    # B A^T - A B^T
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        total = 0.0
        for c in range(3):
            total += B[j, c] * A[i, c] - B[i, c] * A[j, c]
        w[k] = total / 2.0
    s = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    angle = acos(max(-1.0, min(1.0, (trace - 1.0) / 2.0))) if s > 1e-4 else s
    for k in range(3):
        w[k] *= angle / s if s > 1e-12 else 1.0


@compiled
def _step_between(A, B, step):
    """step (6,): from pose A to pose B, (4, 4) each, m and rad along the base's axes."""
    w = np.empty(3)
    _rotation_between(A, B, w)
    for r in range(3):
        step[r], step[r + 3] = B[r, 3] - A[r, 3], w[r]


@compiled
def _turn(T, w, dt):
    """Turn and move T by the twist w (6,) for dt, along the base's axes."""
    for r in range(3):
        T[r, 3] += w[r] * dt
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
def _norm(v, first):
    return sqrt(v[first] * v[first] + v[first + 1] * v[first + 1] + v[first + 2] * v[first + 2])


@compiled
def inverse_step(body, setting, T_goal, elbow, with_elbow, q):
    """Move q (7,) towards the pose T_goal of the end effector by one damped Newton step; return the error's norm.

    Without an elbow the smallest motion, with one joint 3 goes where the elbow says and the others make up for it.
    """
    T, error, w = np.empty((4, 4)), np.empty(6), np.empty(3)
    forward_kinematics(body, q)
    product(body.T, setting.face_T_EE, T)
    _rotation_between(T, T_goal, w)
    for r in range(3):
        error[r], error[r + 3] = T_goal[r, 3] - T[r, 3], w[r]
    # the Jacobian is that of the pad's face: move the error there
    lx, ly, lz = body.T[0, 3] - T[0, 3], body.T[1, 3] - T[1, 3], body.T[2, 3] - T[2, 3]
    error[0] += error[4] * lz - error[5] * ly
    error[1] += error[5] * lx - error[3] * lz
    error[2] += error[3] * ly - error[4] * lx
    size = 0.0
    for r in range(6):
        size += error[r] * error[r]
    J, JJ, L = body.J, body.JJ, body.factor
    step3 = elbow - q[2] if with_elbow else 0.0
    if with_elbow:
        for r in range(6):
            error[r] -= J[r, 2] * step3
    for i in range(6):
        for k in range(i + 1):
            total = 0.0
            for j in range(JOINTS):
                if not (with_elbow and j == 2):
                    total += J[i, j] * J[k, j]
            JJ[i, k] = total
    if not cholesky(JJ, _IK_DAMPING * _IK_DAMPING, L):
        return size
    solve(L, error)
    for j in range(JOINTS):
        if with_elbow and j == 2:
            q[j] += step3
            continue
        for r in range(6):
            q[j] += J[r, j] * error[r]
    return size


@compiled
def start_motion(motion, body, setting, q_start):
    """Begin at rest at q_start (7,): the pose, the elbow and all rates follow from it."""
    forward_kinematics(body, q_start)
    product(body.T, setting.face_T_EE, motion.O_T_EE_d)
    motion.O_T_EE_c[:] = motion.O_T_EE_d
    for j in range(JOINTS):
        motion.q_d[j], motion.dq_d[j], motion.ddq_d[j] = q_start[j], 0.0, 0.0
    for i in range(6):
        motion.O_dP_EE_d[i], motion.O_dP_EE_c[i], motion.O_ddP_EE_c[i] = 0.0, 0.0, 0.0
    motion.elbow_c[0] = q_start[2]
    motion.elbow_c[1] = 1.0 if q_start[3] > ELBOW_FLIP else -1.0
    for i in range(2):
        motion.delbow_c[i], motion.ddelbow_c[i] = 0.0, 0.0
    motion.first, motion.with_elbow = 1, 0


@compiled
def _start_of(commanded, measured, desired):
    """Return where a motion starts whose first command is this one: where it is commanded, unless that is a step."""
    start = measured if abs(commanded - measured) < abs(commanded - desired) else desired
    return commanded if abs(commanded - start) <= _START_NOISE else start


@compiled
def follow_joints(motion, command, kind, setting, q_measured):
    """Take a joint position or velocity; return the errors, and change nothing when there are any.

    q_measured (7,): where the first position of a motion may start, besides where the arm is desired to be.
    """
    q, dq, ddq, dddq = np.empty(JOINTS), np.empty(JOINTS), np.empty(JOINTS), np.empty(JOINTS)
    mask = 0
    for j in range(JOINTS):
        if kind == JOINT_POSITION:
            q[j] = command.q_c[j]
            last = motion.q_d[j]
            if motion.first != 0:
                last = _start_of(q[j], q_measured[j], last)
                if not abs(q[j] - last) <= _START:
                    mask |= JMG_START
            dq[j] = (q[j] - last) / DT
        else:
            dq[j] = command.dq_c[j]
            q[j] = motion.q_d[j] + dq[j] * DT
        ddq[j] = (dq[j] - motion.dq_d[j]) / DT
        dddq[j] = (ddq[j] - motion.ddq_d[j]) / DT
    limits = setting.joint_limits
    mask |= _judge_joints(
        q, dq, ddq, dddq, limits, JMG_POSITION, JMG_VELOCITY, JMG_VELOCITY_JUMP, JMG_ACCELERATION_JUMP
    )
    if mask == 0:
        motion.first = 0
        motion.beyond += _beyond(ddq, dddq, limits)
        for j in range(JOINTS):
            motion.q_d[j], motion.dq_d[j], motion.ddq_d[j] = q[j], dq[j], ddq[j]
    return mask


@compiled
def take_target(motion, command, setting):
    """Take a target of an asynchronous motion; return the errors, and change nothing when there are any."""
    for j in range(JOINTS):
        if not setting.joint_limits[0, j] <= command.q_c[j] <= setting.joint_limits[1, j]:
            return VIA_PLANNING
    for j in range(JOINTS):
        motion.target[j] = command.q_c[j]
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
def follow_cartesian(motion, command, kind, body, setting, q_measured):
    """Take a pose or a twist; return the errors, and change nothing when there are any.

    q_measured (7,): where the first pose of a motion may start, besides where the arm is desired to be.
    """
    T, twist = np.empty((4, 4)), np.empty(6)
    limits, most = setting.joint_limits, setting.cartesian_limits
    q_start, elbow_start = motion.q_d.copy(), motion.elbow_c[0]
    mask = 0
    if kind == CARTESIAN_POSITION:
        for r in range(4):
            for c in range(4):
                T[r, c] = command.O_T_EE_c[4 * c + r]
        for a in range(3):
            for b in range(3):
                dot = T[0, a] * T[0, b] + T[1, a] * T[1, b] + T[2, a] * T[2, b]
                if not abs(dot - (1.0 if a == b else 0.0)) <= 1e-4:
                    mask |= CMG_FRAME
        if not (T[3, 0] == 0.0 and T[3, 1] == 0.0 and T[3, 2] == 0.0 and T[3, 3] == 1.0):
            mask |= CMG_FRAME
        if mask != 0:
            return mask
        _step_between(motion.O_T_EE_d, T, twist)
        if motion.first != 0:
            far = max(_norm(twist, 0), _norm(twist, 3))
            T_measured, from_measured = np.empty((4, 4)), np.empty(6)
            forward_kinematics(body, q_measured)
            product(body.T, setting.face_T_EE, T_measured)
            _step_between(T_measured, T, from_measured)
            if max(_norm(from_measured, 0), _norm(from_measured, 3)) < far:
                twist[:] = from_measured
                far = max(_norm(twist, 0), _norm(twist, 3))
                q_start[:] = q_measured
            if not far <= _START:
                mask |= CMG_START
            if far <= _START_NOISE:
                twist[:] = 0.0
        for i in range(6):
            twist[i] /= DT
    else:
        for i in range(6):
            twist[i] = command.O_dP_EE_c[i]
        T[:] = motion.O_T_EE_d
        _turn(T, twist, DT)
    # rates: linear and angular apart
    rate, jump = np.empty(6), np.empty(6)
    for i in range(6):
        rate[i] = (twist[i] - motion.O_dP_EE_c[i]) / DT
        jump[i] = (rate[i] - motion.O_ddP_EE_c[i]) / DT
    if not (_norm(twist, 0) <= _SPARE * most[_TRANSLATION, 0] and _norm(twist, 3) <= _SPARE * most[_ROTATION, 0]):
        mask |= CMG_VELOCITY
    if not (_norm(rate, 0) <= _TOLERATED * most[_TRANSLATION, 1] and _norm(rate, 3) <= _TOLERATED * most[_ROTATION, 1]):
        mask |= CMG_VELOCITY_JUMP
    if not (_norm(jump, 0) <= _TOLERATED * most[_TRANSLATION, 2] and _norm(jump, 3) <= _TOLERATED * most[_ROTATION, 2]):
        mask |= CMG_ACCELERATION_JUMP
    with_elbow, elbow = command.valid_elbow != 0, command.elbow_c[0]
    delbow, ddelbow = 0.0, 0.0
    if with_elbow:
        if motion.first != 0:
            elbow_start = _start_of(elbow, q_measured[2], elbow_start)
            if not abs(elbow - elbow_start) <= _START:
                mask |= CMG_ELBOW_START
        if command.elbow_c[1] != motion.elbow_c[1]:
            mask |= CMG_ELBOW_SIGN
        delbow = (elbow - elbow_start) / DT
        ddelbow = (delbow - motion.delbow_c[0]) / DT
        if not (limits[0, 2] <= elbow <= limits[1, 2] and abs(delbow) <= _SPARE * most[_ELBOW, 0]):
            mask |= CMG_ELBOW
        # the vendor has no name of its own for an elbow that jumps
        if not (abs(ddelbow) <= _TOLERATED * most[_ELBOW, 1]):
            mask |= CMG_ELBOW
        if not (abs(ddelbow - motion.ddelbow_c[0]) / DT <= _TOLERATED * most[_ELBOW, 2]):
            mask |= CMG_ELBOW
    if mask != 0:
        return mask
    q, dq, ddq, dddq = q_start.copy(), np.empty(JOINTS), np.empty(JOINTS), np.empty(JOINTS)
    for _ in range(3):
        inverse_step(body, setting, T, elbow, with_elbow, q)
    if motion.first != 0 and kind == CARTESIAN_POSITION and _norm(twist, 0) == 0.0 and _norm(twist, 3) == 0.0:
        q_start[:] = q  # at rest where it is commanded, not a step from where it was read
    for j in range(JOINTS):
        dq[j] = (q[j] - q_start[j]) / DT
        ddq[j] = (dq[j] - motion.dq_d[j]) / DT
        dddq[j] = (ddq[j] - motion.ddq_d[j]) / DT
    mask |= _judge_joints(
        q, dq, ddq, dddq, limits, CMG_JOINT_POSITION, CMG_JOINT_VELOCITY, CMG_JOINT_VELOCITY_JUMP,
        CMG_JOINT_ACCELERATION_JUMP,
    )  # fmt: skip
    if mask == 0:
        motion.first, motion.with_elbow = 0, with_elbow
        motion.beyond += _beyond(ddq, dddq, limits)
        motion.O_T_EE_d[:], motion.O_T_EE_c[:] = T, T
        for i in range(6):
            motion.O_dP_EE_d[i], motion.O_dP_EE_c[i], motion.O_ddP_EE_c[i] = twist[i], twist[i], rate[i]
        for j in range(JOINTS):
            motion.q_d[j], motion.dq_d[j], motion.ddq_d[j] = q[j], dq[j], ddq[j]
        if with_elbow:
            motion.elbow_c[0], motion.delbow_c[0], motion.ddelbow_c[0] = elbow, delbow, ddelbow
        else:
            motion.elbow_c[0], motion.delbow_c[0], motion.ddelbow_c[0] = q[2], dq[2], ddq[2]
    return mask


@compiled
def extrapolate(motion, kind, body, setting):
    """Get over a lost packet with constant acceleration, joints or pose, as the robot does."""
    if kind <= JOINT_VELOCITY:
        for j in range(JOINTS):
            motion.dq_d[j] += motion.ddq_d[j] * DT
            motion.q_d[j] += motion.dq_d[j] * DT
        return
    for i in range(6):
        motion.O_dP_EE_c[i] += motion.O_ddP_EE_c[i] * DT
        motion.O_dP_EE_d[i] = motion.O_dP_EE_c[i]
    _turn(motion.O_T_EE_d, motion.O_dP_EE_c, DT)
    motion.O_T_EE_c[:] = motion.O_T_EE_d
    if motion.with_elbow != 0:
        motion.delbow_c[0] += motion.ddelbow_c[0] * DT
        motion.elbow_c[0] += motion.delbow_c[0] * DT
    q = motion.q_d.copy()
    for _ in range(3):
        inverse_step(body, setting, motion.O_T_EE_d, motion.elbow_c[0], motion.with_elbow != 0, q)
    for j in range(JOINTS):
        dq = (q[j] - motion.q_d[j]) / DT
        motion.ddq_d[j] = (dq - motion.dq_d[j]) / DT
        motion.q_d[j], motion.dq_d[j] = q[j], dq


@compiled
def ends_too_fast(motion):
    """True when a motion that ends now would end while it moves."""
    for j in range(JOINTS):  # noqa: SIM110 - compiled
        if abs(motion.dq_d[j]) > _END_VELOCITY:
            return True
    return False
