"""One millisecond of the plant, compiled: four substeps of flexible joints around mj_step, called by its C symbol."""

import ctypes
from math import exp, isfinite
from pathlib import Path

import llvmlite.binding
import mujoco
import numpy as np
from numba import types

from hal.compilation import compiled
from sim_robot.arm_description import JOINTS
from sim_robot.model import GRAVITY, SUBSTEPS, TIMESTEP_S
from sim_robot.near_geoms import look, look_at_all, note_motion

_LIBRARY = next(Path(str(mujoco.__file__)).parent.glob("libmujoco.so.*"))
llvmlite.binding.load_library_permanently(str(_LIBRARY))
# mujoco's package has each part of a step read the clock, 80 times a millisecond, for timers that are not used here
ctypes.c_void_p.in_dll(ctypes.CDLL(str(_LIBRARY)), "mjcb_time").value = None
_mj_step = types.ExternalFunction("mj_step", types.void(types.intp, types.intp))

# rad/s or m/s that nothing here reaches: found before MuJoCo's own check, which would write a file
DIVERGED = 1e3

# one record an arm; units as in JointParameters, torques in Nm
JOINT_RECORD = np.dtype(
    [
        *((name, "f8", JOINTS) for name in ("B", "B_theta", "K", "D", "friction_p1", "friction_p2", "friction_p3")),
        ("friction_offset", "f8", JOINTS),  # p1 / (1 + exp(-p2 p3))
        *((name, "f8", JOINTS) for name in ("gravity_factor", "hold_stiffness", "hold_damping", "hold_tau_max")),
        ("payload_error", "f8"),  # kg on the flange that the robot was not told of
    ]
)
MOTOR_RECORD = np.dtype(
    [
        ("theta", "f8", JOINTS),
        ("dtheta", "f8", JOINTS),
        ("dq", "f8", JOINTS),  # of the link at the end of the last ms: what no encoder has blurred
        ("tau_J", "f8", JOINTS),  # torque through the joint, K(theta - q) + D(dtheta - dq), at the end of the last ms
        ("tau_command", "f8", JOINTS),  # gravity excluded
        ("tau_gravity", "f8", JOINTS),  # what the robot adds itself
        ("tau_load", "f8", JOINTS),  # what it adds for a load that it was told of
        ("tau_desired", "f8", JOINTS),  # tau_command, or the torque that holds
        ("theta_hold", "f8", JOINTS),
        ("dtheta_hold", "f8", JOINTS),  # theta_hold moves on at this velocity
        ("tau_applied", "f8", JOINTS),  # a force applied from outside, seen at the joints
        ("tau_ext", "f8", JOINTS),  # contacts and tau_applied over the last ms, positive where the arm pushes
        ("holding", "i8"),
    ]
)


@compiled
def advance_millisecond(
    model_address, data_address, qpos, qvel, qfrc_applied, qfrc_constraint, xanchor, xaxis, subtree_com,
    subtree_mass, link1_bodies, joints, motors, pairs, masks, nears, contype, conaffinity, body_contype,
    body_conaffinity, geom_type, geom_size, geom_rbound, geom_xpos, geom_xmat,
):  # fmt: skip
    """Advance the plant by four substeps; False as soon as a velocity is absurd or not finite.

    pairs, masks and nears: see sim_robot.near_geoms.

    In the order of the vendor's loop, with the same old tau_t on both sides of the gear:
    tau_t = K (theta - q) + D (dtheta - dq); the link side takes tau_t for one step; then the motor side
    B ddtheta = tau_act - tau_t + B / B_theta tau_fric, tau_act = B / B_theta tau_d + (1 - B / B_theta) tau_t,
    which is B_theta ddtheta = tau_d - tau_t + tau_fric: (4), (6) and (8) of the impact-map paper.
    """
    arms = joints.shape[0]
    for arm in range(arms):
        motor = motors[arm]
        for j in range(JOINTS):
            body, joint = link1_bodies[arm] + j, arm * JOINTS + j
            rx = subtree_com[body, 0] - xanchor[joint, 0]
            ry = subtree_com[body, 1] - xanchor[joint, 1]
            lever = xaxis[joint, 0] * ry - xaxis[joint, 1] * rx
            motor.tau_gravity[j] = joints[arm].gravity_factor[j] * GRAVITY * subtree_mass[body] * lever
            motor.tau_gravity[j] += motor.tau_load[j]
            motor.tau_ext[j] = 0.0 - motor.tau_load[j]
            if joints[arm].payload_error != 0.0:  # at the centre of mass of the last link with what is on it
                last = link1_bodies[arm] + JOINTS - 1
                rx = subtree_com[last, 0] - xanchor[joint, 0]
                ry = subtree_com[last, 1] - xanchor[joint, 1]
                lever = xaxis[joint, 0] * ry - xaxis[joint, 1] * rx
                unknown = joints[arm].payload_error * GRAVITY * lever
                motor.tau_gravity[j] -= unknown
                motor.tau_ext[j] += unknown
    near = nears[0]
    stale = near.fixed != 0
    for i in range(qpos.shape[0]):
        if qpos[i] != near.qpos[i]:  # it was put there: where the geoms are is not known before the next step
            stale = True
    for _ in range(SUBSTEPS):
        if stale:
            look_at_all(masks, contype, conaffinity, body_contype, body_conaffinity)
            near.room, near.moved = 0.0, 0.0
        elif near.moved >= near.room:
            look(
                pairs, masks, near, contype, conaffinity, body_contype, body_conaffinity, geom_type, geom_size,
                geom_rbound, geom_xpos, geom_xmat,
            )  # fmt: skip
        stale = near.fixed != 0
        for arm in range(arms):
            joint, motor = joints[arm], motors[arm]
            for j in range(JOINTS):
                i = arm * JOINTS + j
                tau_t = joint.K[j] * (motor.theta[j] - qpos[i]) + joint.D[j] * (motor.dtheta[j] - qvel[i])
                if not isfinite(tau_t):
                    return False
                motor.tau_J[j] = tau_t
                qfrc_applied[i] = tau_t + motor.tau_applied[j]
        _mj_step(model_address, data_address)
        note_motion(near, qvel, TIMESTEP_S)
        for arm in range(arms):
            joint, motor = joints[arm], motors[arm]
            for j in range(JOINTS):
                i = arm * JOINTS + j
                tau_t, dtheta = motor.tau_J[j], motor.dtheta[j]
                tau_d = motor.tau_command[j]
                if motor.holding != 0:
                    tau_d = joint.hold_stiffness[j] * (motor.theta_hold[j] - motor.theta[j])
                    tau_d += joint.hold_damping[j] * (motor.dtheta_hold[j] - dtheta)
                    tau_d = max(-joint.hold_tau_max[j], min(joint.hold_tau_max[j], tau_d))
                    motor.theta_hold[j] += TIMESTEP_S * motor.dtheta_hold[j]
                motor.tau_desired[j] = tau_d
                tau_d += motor.tau_gravity[j]
                sigmoid = joint.friction_p1[j] / (1.0 + exp(-joint.friction_p2[j] * (dtheta + joint.friction_p3[j])))
                tau_fric = joint.friction_offset[j] - sigmoid
                ratio = joint.B[j] / joint.B_theta[j]
                tau_act = ratio * tau_d + (1.0 - ratio) * tau_t
                motor.dtheta[j] = dtheta + TIMESTEP_S * (tau_act - tau_t + ratio * tau_fric) / joint.B[j]
                motor.theta[j] += TIMESTEP_S * motor.dtheta[j]
                motor.tau_ext[j] -= (qfrc_constraint[i] + motor.tau_applied[j]) / SUBSTEPS
                if not abs(motor.dtheta[j]) < DIVERGED:
                    return False
        for i in range(qvel.shape[0]):
            if not abs(qvel[i]) < DIVERGED:
                return False
    for arm in range(arms):
        joint, motor = joints[arm], motors[arm]
        for j in range(JOINTS):
            i = arm * JOINTS + j
            motor.tau_J[j] = joint.K[j] * (motor.theta[j] - qpos[i]) + joint.D[j] * (motor.dtheta[j] - qvel[i])
            motor.dq[j] = qvel[i]
    near.qpos[:] = qpos
    return True
