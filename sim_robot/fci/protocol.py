"""The Franka Control Interface on the wire: version 10, little-endian, packed.

Source: libfranka's public headers (research_interface/robot), held by the tests against a real pylibfranka client.
Transforms are column-major on the wire.

Which fields are filled by what, which errors come from what, and which replies each request can get is a table of the
documentation, docs/reference/simulated_robot.md. It is made from docs/generate/fidelity.toml, which the tests compare
with this module.
"""

import struct
from enum import IntEnum

import numpy as np

VERSION = 10
PORT = 1337
GRIPPER_VERSION = 3
GRIPPER_PORT = 1338
VACUUM_VERSION = 1
VACUUM_PORT = 1339

HEADER = struct.Struct("<III")  # command, command id, size with this header
GRIPPER_HEADER = struct.Struct("<HII")


class Command(IntEnum):
    """Requests over TCP."""

    CONNECT = 0
    MOVE = 1
    STOP_MOVE = 2
    SET_COLLISION_BEHAVIOR = 3
    SET_JOINT_IMPEDANCE = 4
    SET_CARTESIAN_IMPEDANCE = 5
    SET_GUIDING_MODE = 6
    SET_EE_TO_K = 7
    SET_NE_TO_EE = 8
    SET_LOAD = 9
    AUTOMATIC_ERROR_RECOVERY = 10
    GET_ROBOT_MODEL = 11


# the payload after the header; a request of any other size is not trusted
PAYLOADS: dict[Command, struct.Struct] = {
    Command.CONNECT: struct.Struct("<HH"),  # version, client's UDP port
    # controller, generator, path and goal deviation (translation, rotation, elbow), asynchronous?, largest velocities
    Command.MOVE: struct.Struct("<II3d3dB7d"),
    Command.STOP_MOVE: struct.Struct("<"),
    # lower and upper torque thresholds while accelerating, then at constant velocity (4 x 7); forces likewise (4 x 6)
    Command.SET_COLLISION_BEHAVIOR: struct.Struct("<52d"),
    Command.SET_JOINT_IMPEDANCE: struct.Struct("<7d"),
    Command.SET_CARTESIAN_IMPEDANCE: struct.Struct("<6d"),
    Command.SET_GUIDING_MODE: struct.Struct("<7B"),
    Command.SET_EE_TO_K: struct.Struct("<16d"),
    Command.SET_NE_TO_EE: struct.Struct("<16d"),
    Command.SET_LOAD: struct.Struct("<13d"),  # mass, centre in the flange (3), inertia (9)
    Command.AUTOMATIC_ERROR_RECOVERY: struct.Struct("<"),
    Command.GET_ROBOT_MODEL: struct.Struct("<"),
}


class ConnectStatus(IntEnum):
    """Answer to Connect."""

    SUCCESS = 0
    INCOMPATIBLE_VERSION = 1
    TAKEN = 2  # not the vendor's: another client has the arm. A libfranka client raises a protocol error


class MoveStatus(IntEnum):
    """Both answers to Move: at the start and at the end."""

    SUCCESS = 0
    MOTION_STARTED = 1
    PREEMPTED = 2
    PREEMPTED_SAFETY = 3
    REJECTED_SAFETY = 4
    NOT_POSSIBLE = 5
    SINGULAR_START = 6
    INVALID_ARGUMENT = 7
    REFLEX_ABORTED = 8
    EMERGENCY_ABORTED = 9
    INPUT_ERROR_ABORTED = 10
    ABORTED = 11


class SetStatus(IntEnum):
    """Answer to every Set request and to GetRobotModel."""

    SUCCESS = 0
    NOT_POSSIBLE = 1
    INVALID_ARGUMENT = 2
    SAFETY = 3


class RecoveryStatus(IntEnum):
    """Answer to AutomaticErrorRecovery."""

    SUCCESS = 0
    NOT_POSSIBLE = 1
    SAFETY = 2
    MANUAL_REQUIRED = 3
    REFLEX = 4


class Controller(IntEnum):
    """Who turns the motion into torques, as Move asks for it and as the state shows it."""

    JOINT_IMPEDANCE = 0
    CARTESIAN_IMPEDANCE = 1
    EXTERNAL = 2
    OTHER = 3  # state only


class Generator(IntEnum):
    """What the client sends, as Move asks for it. The state shows this plus one; 0 is idle."""

    JOINT_POSITION = 0
    JOINT_VELOCITY = 1
    CARTESIAN_POSITION = 2
    CARTESIAN_VELOCITY = 3
    NONE = 4


GENERATOR_IDLE = 0

ERRORS = 41


def _floats(size: int, *names: str) -> list[tuple[str, str, int]]:
    return [(name, "<f4", size) for name in names]


ROBOT_STATE = np.dtype(
    [
        ("message_id", "<u8"),
        *_floats(16, "O_T_EE", "O_T_EE_d", "F_T_EE", "EE_T_K", "F_T_NE", "NE_T_EE"),
        ("m_ee", "<f4"),
        ("I_ee", "<f4", 9),
        ("F_x_Cee", "<f4", 3),
        ("m_load", "<f4"),
        ("I_load", "<f4", 9),
        ("F_x_Cload", "<f4", 3),
        *_floats(2, "elbow", "elbow_d"),
        *_floats(7, "tau_J", "tau_J_d", "dtau_J", "q", "q_d", "dq", "dq_d", "ddq_d"),
        ("joint_contact", "<f4", 7),
        ("cartesian_contact", "<f4", 6),
        ("joint_collision", "<f4", 7),
        ("cartesian_collision", "<f4", 6),
        ("tau_ext_hat_filtered", "<f4", 7),
        *_floats(6, "O_F_ext_hat_K", "K_F_ext_hat_K", "O_dP_EE_d"),
        ("O_ddP_O", "<f4", 3),
        *_floats(2, "elbow_c", "delbow_c", "ddelbow_c"),
        ("O_T_EE_c", "<f4", 16),
        *_floats(6, "O_dP_EE_c", "O_ddP_EE_c"),
        *_floats(7, "theta", "dtheta"),
        ("accelerometer_top", "<f4", (6, 3)),
        ("accelerometer_bottom", "<f4", (6, 3)),
        ("motion_generator_mode", "u1"),
        ("controller_mode", "u1"),
        ("errors", "u1", ERRORS),
        ("reflex_reason", "u1", ERRORS),
        ("robot_mode", "u1"),
        ("control_command_success_rate", "<f4"),
    ]
)

ROBOT_COMMAND = np.dtype(
    [
        ("message_id", "<u8"),
        ("q_c", "<f8", 7),
        ("dq_c", "<f8", 7),
        ("O_T_EE_c", "<f8", 16),
        ("O_dP_EE_c", "<f8", 6),
        ("elbow_c", "<f8", 2),
        ("valid_elbow", "u1"),
        ("motion_generation_finished", "u1"),
        ("tau_J_d", "<f8", 7),
        ("torque_command_finished", "u1"),
    ]
)

assert ROBOT_STATE.itemsize == 1377  # what a version 10 client expects
assert ROBOT_COMMAND.itemsize == 371
assert PAYLOADS[Command.MOVE].size == 113


def response(command: int, command_id: int, body: bytes) -> bytes:
    """Return an answer with its header."""
    return HEADER.pack(command, command_id, HEADER.size + len(body)) + body
