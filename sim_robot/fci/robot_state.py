"""RobotState: from what the sensors measured and the controllers want to what goes over the wire. Compiled."""

from math import cos, floor, log, pi, sqrt

import numpy as np

from hal.compilation import compiled
from sim_robot.arm_description import JOINTS
from sim_robot.kinematics import forward_kinematics

GRAVITY_ACCELERATION = -9.81  # O_ddP_O, along the base's z
# elbow[1] is +1 above this position of joint 4, -1 below (robot_state.h)
ELBOW_FLIP = -0.467002423653011
# m/s^2: noise over the 442 Hz of a mean over 1 ms (290 ug/sqrt(Hz)), a bit (3.9 mg) and the range (16 g) of a
# consumer's accelerometer, an ADXL345 by its data sheet; the vendor does not say what the arm has
ACCELEROMETER_NOISE, ACCELEROMETER_BIT, ACCELEROMETER_RANGE = 0.0598, 0.03826, 156.96

# What the controllers want: the generators fill it. Transforms row-major. _d: desired now, _c: as the client commands.
MOTION_RECORD = np.dtype(
    [
        ("first", "i8"),  # 1: no command of this motion yet
        ("beyond", "i8"),  # commands beyond the published limits that the robot tolerated
        ("with_elbow", "i8"),  # 1: the last command carried an elbow
        ("following", "i8"),  # 1: nothing is desired but what is measured (torque control)
        *((name, "f8", JOINTS) for name in ("q_d", "dq_d", "ddq_d")),
        ("asynchronous", "i8"),  # 1: the client sends targets when it likes, and the robot finds the way
        ("target", "f8", JOINTS),
        ("largest_velocity", "f8", JOINTS),  # on the way there
        ("cartesian", "i8"),  # 1: the client commands poses or twists
        ("O_T_EE_d", "f8", (4, 4)),
        ("O_dP_EE_d", "f8", 6),
        ("O_T_EE_c", "f8", (4, 4)),
        ("O_dP_EE_c", "f8", 6),
        ("O_ddP_EE_c", "f8", 6),
        *((name, "f8", 2) for name in ("elbow_c", "delbow_c", "ddelbow_c")),
        ("watching", "i8"),  # 1: moving, so that an upper threshold is a collision
        ("joint_contact", "f8", JOINTS),
        ("cartesian_contact", "f8", 6),
        ("joint_collision", "f8", JOINTS),  # latched until the recovery
        ("cartesian_collision", "f8", 6),
        ("velocity_last", "f8", (6, 3)),  # of the joints' origins, for the accelerometers
        ("acceleration", "f8", (6, 3)),
        ("noise", "u8"),  # state of the accelerometers' own generator
        ("started", "i8"),
        ("base_shaken", "f8", 3),  # what the base's accelerometer reads beside gravity, m/s^2
    ]
)
# result of `fill_states`, as a mask
JOINT_COLLISION, CARTESIAN_COLLISION = 1, 2


@compiled
def product(A, B, C):
    """C = A B for transforms (4, 4); C is neither A nor B."""
    for r in range(3):
        for c in range(4):
            total = A[r, 0] * B[0, c] + A[r, 1] * B[1, c] + A[r, 2] * B[2, c]
            C[r, c] = total + (A[r, 3] if c == 3 else 0.0)
    C[3, 0], C[3, 1], C[3, 2], C[3, 3] = 0.0, 0.0, 0.0, 1.0


@compiled
def elbow_sign(q4):
    """Return elbow[1] for a position of joint 4, rad."""
    return 1.0 if q4 > ELBOW_FLIP else (-1.0 if q4 < ELBOW_FLIP else 0.0)


@compiled
def _columns(T, wire):
    for c in range(4):
        for r in range(4):
            wire[4 * c + r] = T[r, c]


@compiled
def _twist(kinematics, dq, lever, twist):
    """twist (6,) of a point at `lever` (3,) from the Jacobian's point, along the base's axes."""
    for r in range(6):
        total = 0.0
        for j in range(JOINTS):
            total += kinematics.J[r, j] * dq[j]
        twist[r] = total
    twist[0] += twist[4] * lever[2] - twist[5] * lever[1]
    twist[1] += twist[5] * lever[0] - twist[3] * lever[2]
    twist[2] += twist[3] * lever[1] - twist[4] * lever[0]


@compiled
def _acceleration(kinematics, motion, T, acceleration):
    """acceleration (6,) of the point that T (4, 4) places, J ddq + dJ/dt dq of what is desired, link by link."""
    w, dw, a = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for j in range(JOINTS):
        x, o = kinematics.axes[j], kinematics.origins[j]
        z, dq, ddq = (x[0], x[1], x[2]), motion.dq_d[j], motion.ddq_d[j]
        turn = _cross(w, z)
        dw = (dw[0] + turn[0] * dq + z[0] * ddq, dw[1] + turn[1] * dq + z[1] * ddq, dw[2] + turn[2] * dq + z[2] * ddq)
        w = (w[0] + z[0] * dq, w[1] + z[1] * dq, w[2] + z[2] * dq)
        if j + 1 < JOINTS:
            n = kinematics.origins[j + 1]
            r = (n[0] - o[0], n[1] - o[1], n[2] - o[2])
        else:
            r = (T[0, 3] - o[0], T[1, 3] - o[1], T[2, 3] - o[2])
        along, towards = _cross(dw, r), _cross(w, _cross(w, r))
        a = (a[0] + along[0] + towards[0], a[1] + along[1] + towards[1], a[2] + along[2] + towards[2])
    for i in range(3):
        acceleration[i], acceleration[i + 3] = a[i], dw[i]


@compiled
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def _levels(value, lower, upper, watching, contact, collision):
    """Set contact (n,) anew, raise collision (n,) for good; True when a collision is new or goes on."""
    over = False
    for i in range(len(value)):
        contact[i] = 1.0 if abs(value[i]) > lower[i] else 0.0
        if watching != 0 and abs(value[i]) > upper[i]:
            collision[i] = 1.0
            over = True
    return over


@compiled
def fill_states(states, measured, desired, settings, motions, motors, wires, collisions):
    """Fill the wires from the states, all of them (n,), and tell in `collisions` (n,) who is above its thresholds.

    measured: the sensors' KINEMATICS_RECORD at the measured q; desired: a second one, for q_d. Modes, errors and the
    message id are not filled here.
    """
    T, lever, twist, wrench = np.empty((4, 4)), np.empty(3), np.empty(6), np.empty(6)
    for arm in range(states.shape[0]):
        state, body, setting, motion, wire = states[arm], measured[arm], settings[arm], motions[arm], wires[arm]
        wire.q[:], wire.dq[:], wire.theta[:], wire.dtheta[:] = state.q, state.dq, state.theta, state.dtheta
        wire.tau_J[:], wire.dtau_J[:], wire.tau_J_d[:] = state.tau_J, state.dtau_J, state.tau_J_d
        wire.tau_ext_hat_filtered[:] = state.tau_ext_hat_filtered
        product(body.T, setting.face_T_EE, T)
        _columns(T, wire.O_T_EE)
        _columns(setting.F_T_EE, wire.F_T_EE)
        _columns(setting.EE_T_K, wire.EE_T_K)
        _columns(setting.F_T_NE, wire.F_T_NE)
        _columns(setting.NE_T_EE, wire.NE_T_EE)
        wire.m_ee, wire.m_load = setting.m_ee, setting.m_load
        wire.I_ee[:], wire.I_load[:] = setting.I_ee, setting.I_load
        wire.F_x_Cee[:], wire.F_x_Cload[:] = setting.F_x_Cee, setting.F_x_Cload
        for i in range(3):
            wire.O_ddP_O[i] = motion.base_shaken[i] + (GRAVITY_ACCELERATION if i == 2 else 0.0)
        wire.elbow[0], wire.elbow[1] = state.q[2], elbow_sign(state.q[3])

        # what is desired, and what the client commands
        if motion.following != 0:
            motion.q_d[:], motion.dq_d[:], motion.ddq_d[:] = state.q, state.dq, 0.0
        goal = desired[arm]
        forward_kinematics(goal, motion.q_d)
        if motion.cartesian == 0:
            product(goal.T, setting.face_T_EE, motion.O_T_EE_d)
            lever[:] = motion.O_T_EE_d[:3, 3] - goal.T[:3, 3]
            _twist(goal, motion.dq_d, lever, motion.O_dP_EE_d)
            motion.O_T_EE_c[:] = motion.O_T_EE_d
            _acceleration(goal, motion, motion.O_T_EE_d, motion.O_ddP_EE_c)
            motion.O_dP_EE_c[:] = motion.O_dP_EE_d
            motion.elbow_c[0], motion.elbow_c[1] = motion.q_d[2], elbow_sign(motion.q_d[3])
            motion.delbow_c[0], motion.ddelbow_c[0] = motion.dq_d[2], motion.ddq_d[2]
        wire.q_d[:], wire.dq_d[:], wire.ddq_d[:] = motion.q_d, motion.dq_d, motion.ddq_d
        _columns(motion.O_T_EE_d, wire.O_T_EE_d)
        _columns(motion.O_T_EE_c, wire.O_T_EE_c)
        wire.O_dP_EE_d[:], wire.O_dP_EE_c[:] = motion.O_dP_EE_d, motion.O_dP_EE_c
        wire.O_ddP_EE_c[:] = motion.O_ddP_EE_c
        wire.elbow_d[0], wire.elbow_d[1] = motion.q_d[2], elbow_sign(motion.q_d[3])
        wire.elbow_c[:], wire.delbow_c[:], wire.ddelbow_c[:] = motion.elbow_c, motion.delbow_c, motion.ddelbow_c

        # what the robot carries of a load that was set
        centre = setting.F_x_Cload
        product(body.T, setting.face_T_F, T)
        for r in range(3):
            lever[r] = T[r, 3] + T[r, 0] * centre[0] + T[r, 1] * centre[1] + T[r, 2] * centre[2]
        for j in range(JOINTS):
            axis, origin = body.axes[j], body.origins[j]
            lift = axis[0] * (lever[1] - origin[1]) - axis[1] * (lever[0] - origin[0])
            motors[arm].tau_load[j] = -GRAVITY_ACCELERATION * setting.m_load * lift

        # the wrench about K, along the base's axes and along K's
        product(body.T, setting.face_T_K, T)
        wrench[:] = body.wrench
        lever[:] = body.T[:3, 3] - T[:3, 3]
        wrench[3] += lever[1] * wrench[2] - lever[2] * wrench[1]
        wrench[4] += lever[2] * wrench[0] - lever[0] * wrench[2]
        wrench[5] += lever[0] * wrench[1] - lever[1] * wrench[0]
        for r in range(3):
            twist[r] = T[0, r] * wrench[0] + T[1, r] * wrench[1] + T[2, r] * wrench[2]
            twist[r + 3] = T[0, r] * wrench[3] + T[1, r] * wrench[4] + T[2, r] * wrench[5]
        wire.O_F_ext_hat_K[:], wire.K_F_ext_hat_K[:] = wrench, twist

        # contact and collision by the client's thresholds: other ones while accelerating
        row = 0 if motion.ddq_d.any() else 2
        lower, upper, mask, on = setting.torque_thresholds[row], setting.torque_thresholds[row + 1], 0, motion.watching
        if _levels(state.tau_ext_hat_filtered, lower, upper, on, motion.joint_contact, motion.joint_collision):
            mask |= JOINT_COLLISION
        lower, upper = setting.force_thresholds[row], setting.force_thresholds[row + 1]
        if _levels(twist, lower, upper, on, motion.cartesian_contact, motion.cartesian_collision):
            mask |= CARTESIAN_COLLISION
        collisions[arm] = mask
        wire.joint_contact[:], wire.joint_collision[:] = motion.joint_contact, motion.joint_collision
        wire.cartesian_contact[:] = motion.cartesian_contact
        wire.cartesian_collision[:] = motion.cartesian_collision
        _accelerometers(body, state.q, motors[arm].dq, motion, wire)


@compiled
def _uniform(motion):
    """SplitMix64 (Steele, Lea, Flood, OOPSLA 2014), in (0, 1)."""
    motion.noise += np.uint64(0x9E3779B97F4A7C15)
    x = motion.noise
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    x ^= x >> np.uint64(31)
    return (float(x >> np.uint64(11)) + 0.5) / 9007199254740992.0


@compiled
def _normal(motion):
    """A standard normal number (Box and Muller); the sensors' own draws stay what they are."""
    return sqrt(-2.0 * log(_uniform(motion))) * cos(2.0 * pi * _uniform(motion))


@compiled
def _accelerometers(body, q, dq, motion, wire):
    """What an accelerometer at each end of links 1 to 6 reads: acceleration minus gravity, along the link's axes.

    bottom[i] sits at joint i + 1, top[i] at joint i + 2. dq (7,) is the plant's own, so that this is the mean
    acceleration over the last millisecond, not what encoders tell anyway; each axis has noise of its own.
    """
    v, a = np.empty(3), np.empty(3)
    for i in range(6):
        # velocity of the origin of joint i + 2
        v[:] = 0.0
        point = body.origins[i + 1]
        for j in range(i + 1):
            turn = _cross(body.axes[j], point - body.origins[j])
            for r in range(3):
                v[r] += turn[r] * dq[j]
        if motion.started != 0:
            motion.acceleration[i] = (v - motion.velocity_last[i]) * 1e3
        motion.velocity_last[i] = v
    if motion.started == 0:
        motion.noise = np.uint64(np.int64(q[0] * 1e15))  # the cell's seed decides it
    motion.started = 1
    for i in range(6):
        R = body.R[i]
        for end in range(2):
            a[0], a[1], a[2] = 0.0, 0.0, -GRAVITY_ACCELERATION
            if i + end > 0:
                a += motion.acceleration[i + end - 1]
            for c in range(3):
                value = R[0, c] * a[0] + R[1, c] * a[1] + R[2, c] * a[2] + ACCELEROMETER_NOISE * _normal(motion)
                value = min(max(value, -ACCELEROMETER_RANGE), ACCELEROMETER_RANGE)
                readings = wire.accelerometer_bottom if end == 0 else wire.accelerometer_top
                readings[i, c] = ACCELEROMETER_BIT * floor(value / ACCELEROMETER_BIT + 0.5)
