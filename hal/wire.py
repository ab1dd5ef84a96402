"""The Franka Control Interface on the wire, as far as both of its ends need it: version 10, little-endian, packed.

Source: libfranka's public headers (libfranka-common, research_interface/robot and gripper), held by the tests against a
real pylibfranka client. Transforms are column-major on the wire.
"""

import struct

import numpy as np

from hal.robot_errors import ROBOT_ERRORS

VERSION = 10
PORT = 1337
GRIPPER_VERSION = 3
GRIPPER_PORT = 1338

HEADER = struct.Struct("<III")  # command, command id, size with this header
GRIPPER_HEADER = struct.Struct("<HII")
CONNECT = struct.Struct("<HH")  # version, client's UDP port


def _floats(size: int, *names: str) -> list[tuple[str, str, int]]:
    return [(name, "<f4", size) for name in names]


ROBOT_STATE = np.dtype(
    [
        ("message_id", "<u8"),
        *_floats(16, "O_T_EE", "O_T_EE_d", "F_T_EE", "EE_T_K", "F_T_NE", "NE_T_EE"),
        ("m_ee", "<f4"), ("I_ee", "<f4", 9), ("F_x_Cee", "<f4", 3),
        ("m_load", "<f4"), ("I_load", "<f4", 9), ("F_x_Cload", "<f4", 3),
        *_floats(2, "elbow", "elbow_d"),
        *_floats(7, "tau_J", "tau_J_d", "dtau_J", "q", "q_d", "dq", "dq_d", "ddq_d"),
        ("joint_contact", "<f4", 7), ("cartesian_contact", "<f4", 6),
        ("joint_collision", "<f4", 7), ("cartesian_collision", "<f4", 6),
        ("tau_ext_hat_filtered", "<f4", 7),
        *_floats(6, "O_F_ext_hat_K", "K_F_ext_hat_K", "O_dP_EE_d"),
        ("O_ddP_O", "<f4", 3),
        *_floats(2, "elbow_c", "delbow_c", "ddelbow_c"),
        ("O_T_EE_c", "<f4", 16),
        *_floats(6, "O_dP_EE_c", "O_ddP_EE_c"),
        *_floats(7, "theta", "dtheta"),
        ("accelerometer_top", "<f4", (6, 3)), ("accelerometer_bottom", "<f4", (6, 3)),
        ("motion_generator_mode", "u1"), ("controller_mode", "u1"),
        ("errors", "u1", len(ROBOT_ERRORS)), ("reflex_reason", "u1", len(ROBOT_ERRORS)),
        ("robot_mode", "u1"), ("control_command_success_rate", "<f4"),
    ]
)  # fmt: skip

ROBOT_COMMAND = np.dtype(
    [
        ("message_id", "<u8"),
        ("q_c", "<f8", 7), ("dq_c", "<f8", 7), ("O_T_EE_c", "<f8", 16), ("O_dP_EE_c", "<f8", 6), ("elbow_c", "<f8", 2),
        ("valid_elbow", "u1"), ("motion_generation_finished", "u1"),
        ("tau_J_d", "<f8", 7), ("torque_command_finished", "u1"),
    ]
)  # fmt: skip

assert ROBOT_STATE.itemsize == 1377  # what a version 10 client expects
assert ROBOT_COMMAND.itemsize == 371
