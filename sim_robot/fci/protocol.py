"""The requests of the Franka Control Interface, version 10, and their answers, by libfranka's public headers."""

import struct
from enum import IntEnum

VACUUM_VERSION = 1
VACUUM_PORT = 1339


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


class StopStatus(IntEnum):
    """Answer to StopMove. The vendor's has ABORTED = 5, too, which libfranka reads as NOT_POSSIBLE."""

    SUCCESS = 0
    NOT_POSSIBLE = 1
    SAFETY = 2
    EMERGENCY_ABORTED = 3
    REFLEX_ABORTED = 4


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

assert PAYLOADS[Command.MOVE].size == 113
