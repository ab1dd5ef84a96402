"""The robot's own Cartesian impedance controller, 1 kHz. The joint impedance runs in the plant's 4 kHz loop."""

from math import sqrt

import numpy as np

from hal.compilation import compiled
from sim_robot.arm_description import JOINTS
from sim_robot.fci.robot_state import product
from sim_robot.kinematics import cholesky, forward_kinematics, solve

# inertia that the damping is critical for, seen at the end effector: kg, kg m^2 (the vendor publishes none)
_MASS, _INERTIA = 4.0, 0.1
# holds the elbow, Nm/rad and Nms/rad, in what motion of the joints leaves the end effector
_NULL_STIFFNESS, _NULL_DAMPING = 20.0, 5.0


@compiled
def cartesian_impedance(state, motion, setting, measured, desired, tau):
    """Set tau (7,), Nm without gravity: J^T (K_x e + D_x de) along the axes of the stiffness frame, and the elbow.

    `measured` and `desired` are scratch KINEMATICS_RECORDs. With a joint generator the pose follows from q_d.
    """
    T, T_d, e = np.empty((4, 4)), np.empty((4, 4)), np.empty(6)
    forward_kinematics(desired, motion.q_d)
    product(desired.T, setting.face_T_K, T_d)
    forward_kinematics(measured, state.q)
    product(measured.T, setting.face_T_K, T)
    J = measured.J
    lever = (T[0, 3] - measured.T[0, 3], T[1, 3] - measured.T[1, 3], T[2, 3] - measured.T[2, 3])
    for j in range(JOINTS):
        ax, ay, az = J[3, j], J[4, j], J[5, j]
        J[0, j] += ay * lever[2] - az * lever[1]
        J[1, j] += az * lever[0] - ax * lever[2]
        J[2, j] += ax * lever[1] - ay * lever[0]
    # half the sum of the axes' cross products: the sine of the angle, enough for what a stiff controller leaves
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        total = 0.0
        for c in range(3):
            total += T[a, c] * T_d[b, c] - T[b, c] * T_d[a, c]
        e[k], e[k + 3] = T_d[k, 3] - T[k, 3], total / 2.0
    wrench = np.zeros(6)
    for half in range(2):
        for c in range(3):  # along the axes of K
            error, rate = 0.0, 0.0
            for r in range(3):
                error += T[r, c] * e[3 * half + r]
                for j in range(JOINTS):
                    rate += T[r, c] * J[3 * half + r, j] * (motion.dq_d[j] - state.dq[j])
            K = setting.K_x[3 * half + c]
            force = K * error + 2.0 * sqrt(K * (_MASS if half == 0 else _INERTIA)) * rate
            for r in range(3):
                wrench[3 * half + r] += T[r, c] * force
    null = np.empty(JOINTS)
    for j in range(JOINTS):
        null[j] = _NULL_STIFFNESS * (motion.q_d[j] - state.q[j]) + _NULL_DAMPING * (motion.dq_d[j] - state.dq[j])
    # take out of `null` what pushes the end effector: null - J^T (J J^T + d I)^-1 J null
    b = np.zeros(6)
    for i in range(6):
        for j in range(JOINTS):
            b[i] += J[i, j] * null[j]
        for k in range(i + 1):
            measured.JJ[i, k] = 0.0
            for j in range(JOINTS):
                measured.JJ[i, k] += J[i, j] * J[k, j]
    cholesky(measured.JJ, 1e-4, measured.factor)  # positive definite by the shift
    solve(measured.factor, b)
    for j in range(JOINTS):
        total = null[j]
        for i in range(6):
            total += J[i, j] * (wrench[i] - b[i])
        most = setting.joint_limits[7, j]
        tau[j] = max(-most, min(most, total))
