"""What both of the robot's motion generators do: begin a motion, and get over a lost packet. Compiled."""

from hal.compilation import compiled
from sim_robot.arm_description import JOINTS
from sim_robot.fci.joint_motion import DT, JOINT_VELOCITY
from sim_robot.fci.pose_step import inverse_step, turn
from sim_robot.fci.robot_state import ELBOW_FLIP, product
from sim_robot.kinematics import forward_kinematics


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
    turn(motion.O_T_EE_d, motion.O_dP_EE_c, DT)
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
