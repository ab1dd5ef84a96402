"""Protobuf schema of the log, made from the records of rtstack.samples: a FileDescriptorSet, without protoc.

The field names are the records'. t_ns is no field: MCAP's log_time carries it.
"""

from enum import IntEnum

import numpy as np
from google.protobuf import descriptor_pb2

from hal.state import RobotMode
from rtstack.monitor.records import Reason as VerdictReason
from rtstack.monitor.records import Verdict
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, TIMING_SAMPLE, Mode, QpStatus

PACKAGE = "rtstack"
_Field = descriptor_pb2.FieldDescriptorProto

# message -> record, in the order of the file
MESSAGES: dict[str, np.dtype] = {
    "ArmSample": ARM_SAMPLE,
    "ControlSample": CONTROL_SAMPLE,
    "TimingSample": TIMING_SAMPLE,
}
TOPIC_MESSAGES: dict[str, str] = {
    "/left/arm": "ArmSample",
    "/right/arm": "ArmSample",
    "/left/control": "ControlSample",
    "/right/control": "ControlSample",
    "/timing": "TimingSample",
}
ENUM_FIELDS: dict[str, type[IntEnum]] = {
    "robot_mode": RobotMode,
    "mode": Mode,
    "qp_status": QpStatus,
    "impact_verdict": Verdict,
    "impact_reason": VerdictReason,
    "pair_verdict": Verdict,
    "pair_reason": VerdictReason,
}
# what the host's clock measures: all else of a direct or lockstep run is the same again for the same command and seed
HOST_CLOCK_FIELDS: dict[str, tuple[str, ...]] = {
    "/timing": ("period_us", "compute_us", "lateness_us", "pair_skew_us"),
}
ERRORS_FIELD = "current_errors"  # a bit mask in the record, the vendor's names on the wire
COLUMN_MAJOR_FIELD = "O_T_EE"  # row-major in the record, column-major on the wire, as libfranka has it

_COMMENTS: dict[str, str] = {
    "ArmSample": "State of one arm, with libfranka's names and units, and the torques wanted and applied.",
    "ControlSample": "What the controller of one arm did in this tick.",
    "TimingSample": "How the real-time loop kept time.",
    "q": "Joint positions, rad.",
    "dq": "Joint velocities, rad/s.",
    "tau_J": "Measured joint torques, Nm, gravity included.",
    "tau_J_d": "Commanded joint torques as the robot echoes them, Nm, gravity excluded.",
    "dtau_J": "Derivative of the measured joint torques, Nm/s.",
    "theta": "Motor positions, rad.",
    "dtheta": "Motor velocities, rad/s.",
    "tau_ext_hat_filtered": "Estimated external torques, Nm.",
    "O_T_EE": "Pose of the end effector (the pad's face) in the base: 4x4, column-major, m.",
    "O_F_ext_hat_K": "External wrench about the stiffness frame along the base's axes: force N, torque Nm.",
    "control_command_success_rate": "Share of the commands of the last 100 ms that arrived in time, 0 to 1.",
    "robot_mode": "What the robot is doing.",
    "current_errors": "Active errors, by the vendor's names.",
    "tau_desired": "Torques that the controller wanted, Nm, gravity excluded.",
    "tau_applied": "Torques that the safety judge let through, Nm, gravity excluded.",
    "mode": "What the controller is doing.",
    "gamma": "Blending parameter of the interim mode, 0 to 1.",
    "wrench_desired": "Wrench wanted at the end effector along the world's axes: force N, torque Nm.",
    "pose_ref": "Reference pose T_world_ee: x y z in m, then the quaternion qw qx qy qz.",
    "twist_ref": "Reference twist along the world's axes: linear m/s, angular rad/s.",
    "wrench_ff": "Feedforward part of wrench_desired: force N, torque Nm.",
    "beta": "Posture acceleration, rad/s^2.",
    "qp_status": "How the torque of this tick was found.",
    "qp_iterations": "Iterations of the solver.",
    "momentum_residual": "Momentum observer's residual, Nm, with the sign of tau_ext_hat_filtered.",
    "residual_rate": "Rate of the residual, Nm/s.",
    "force_norm": "Norm of the interaction wrenches of both arms.",
    "impact_verdict": "Whether this arm's impact was the one that was meant.",
    "impact_reason": "The first condition of this arm that was not met.",
    "impact_margin": "1 where all is as meant, 0 at the bound of this arm's nearest condition, negative beyond it.",
    "pair_verdict": "Whether the impact of both arms was the one that was meant.",
    "pair_reason": "The first condition of either arm, or of both, that was not met.",
    "pair_margin": "As impact_margin, of both arms and their net force.",
    "period_us": "Time since the last tick, us.",
    "compute_us": "Time from the state's arrival to the command, us.",
    "lateness_us": "How late the state was, us.",
    "missed_deadlines": "Ticks missed since the start.",
    "pair_skew_us": "Between the arrivals of the two arms' newest states, us; 0 where both come together.",
}


def _enum_prefix(name: str) -> str:
    return "".join("_" + c if c.isupper() and i else c for i, c in enumerate(name)).upper()


def _add_enum(file: descriptor_pb2.FileDescriptorProto, enum: type[IntEnum]) -> None:
    added = file.enum_type.add(name=enum.__name__)
    for member in enum:
        added.value.add(name=f"{_enum_prefix(enum.__name__)}_{member.name}", number=int(member))


def _add_field(message: descriptor_pb2.DescriptorProto, name: str, dtype: np.dtype) -> None:
    field = message.field.add(name=name, number=len(message.field) + 1, label=_Field.LABEL_OPTIONAL)
    if name == ERRORS_FIELD:
        field.label, field.type = _Field.LABEL_REPEATED, _Field.TYPE_STRING
    elif name in ENUM_FIELDS:
        field.type, field.type_name = _Field.TYPE_ENUM, f".{PACKAGE}.{ENUM_FIELDS[name].__name__}"
    elif dtype.base == np.int64:
        field.type = _Field.TYPE_SFIXED64  # fixed size: the encoder fills templates
    else:
        field.type = _Field.TYPE_DOUBLE
        if dtype.shape:
            field.label = _Field.LABEL_REPEATED
            field.options.packed = True


def sample_file() -> descriptor_pb2.FileDescriptorProto:
    """Return the descriptor of rtstack/samples.proto, with every field's unit as its comment."""
    file = descriptor_pb2.FileDescriptorProto(name="rtstack/samples.proto", package=PACKAGE, syntax="proto3")
    for enum in dict.fromkeys(ENUM_FIELDS.values()):
        _add_enum(file, enum)
    for message_index, (name, record) in enumerate(MESSAGES.items()):
        message = file.message_type.add(name=name)
        # path: field numbers of descriptor.proto, 4 = message_type of a file, 2 = field of a message
        _add_comment(file, [4, message_index], name)
        for field_name in record.names or ():
            if field_name != "t_ns":
                _add_comment(file, [4, message_index, 2, len(message.field)], field_name)
                _add_field(message, field_name, record[field_name])
    return file


def _add_comment(file: descriptor_pb2.FileDescriptorProto, path: list[int], name: str) -> None:
    file.source_code_info.location.add(path=path, span=[0, 0, 0], leading_comments=f" {_COMMENTS[name]}\n")


def sample_descriptors() -> bytes:
    """Return the serialised FileDescriptorSet of all our messages: the schema data of each of our topics."""
    files = descriptor_pb2.FileDescriptorSet(file=[sample_file()])
    return files.SerializeToString(deterministic=True)
