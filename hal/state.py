"""State of an arm, with libfranka's names, as one fixed-size record.

It is one contiguous block: the loop copies it, compiled code indexes it by name, the log's schema is made from it.
"""

from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.base.record import JOINTS, MATRIX, WRENCH, Field, record_of
from hal.robot_errors import ROBOT_ERRORS


class RobotMode(IntEnum):
    """libfranka's RobotMode."""

    OTHER = 0
    IDLE = 1
    MOVE = 2
    GUIDING = 3
    REFLEX = 4
    USER_STOPPED = 5
    AUTOMATIC_ERROR_RECOVERY = 6


# modes out of which only a person at the robot leads, and what the person does
NEEDS_PERSON = {
    RobotMode.USER_STOPPED: "its user stop is pressed: release it",
    RobotMode.GUIDING: "it is guided by hand: let go of the buttons at its wrist",
    RobotMode.OTHER: "it gives no control: on its Desk page unlock the joints, activate FCI, leave Programming",
}


# O_T_EE is row-major here, column-major on the wire and in the log (libfranka's layout). O_F_ext_hat_K is positive
# where the robot pushes the environment, and tau_ext_hat_filtered has its sign.
ARM_STATE_FIELDS = (
    Field("q", "Joint positions, {unit}.", "rad", JOINTS, plain="joint position"),
    Field("dq", "Joint velocities, {unit}.", "rad/s", JOINTS, plain="joint velocity"),
    Field("tau_J", "Measured joint torques, {unit}, gravity included.", "Nm", JOINTS, plain="joint torque, measured"),
    Field("tau_J_d", "Commanded joint torques as the robot echoes them, {unit}, gravity excluded.", "Nm", JOINTS,
          plain="joint torque, commanded"),
    Field("dtau_J", "Derivative of the measured joint torques, {unit}.", "Nm/s", JOINTS,
          plain="rate of the joint torque"),
    Field("theta", "Motor positions, {unit}.", "rad", JOINTS, plain="motor position"),
    Field("dtheta", "Motor velocities, {unit}.", "rad/s", JOINTS, plain="motor velocity"),
    Field("tau_ext_hat_filtered", "Estimated external torques, {unit}.", "Nm", JOINTS, plain="external joint torque"),
    Field("O_T_EE", "Pose of the end effector (the pad's face) in the base: 4x4, column-major, {unit}.", "m", MATRIX,
          frame="base", shape=(4, 4), column_major=True, plain="pad's pose in the base"),
    Field("O_F_ext_hat_K", "External wrench about the stiffness frame along the base's axes: force N, torque Nm.",
          "N, Nm", WRENCH, frame="base", plain="force and torque on the environment"),
    Field("control_command_success_rate", "Share of the commands of the last 100 ms that arrived in time, 0 to 1.",
          plain="commands that arrived in time"),
    Field("robot_mode", "What the robot is doing.", enum=RobotMode, plain="robot mode"),
    Field("current_errors", "Active errors, by the vendor's names.", bits=ROBOT_ERRORS, plotted=False),
)  # fmt: skip
ARM_STATE = record_of(ARM_STATE_FIELDS)
"""The record of a state: t_ns (robot's time, ns), then the fields with libfranka's names and units."""


@dataclass(frozen=True, slots=True)
class ArmState:
    """One arm's state: a record of dtype ARM_STATE, shape (1,), and views of its arrays.

    The arm owns it and overwrites it at each `read`: copy what has to last.
    """

    record: NDArray[Any]
    q: NDArray[np.float64]
    dq: NDArray[np.float64]
    tau_J: NDArray[np.float64]
    tau_ext_hat_filtered: NDArray[np.float64]
    O_T_EE: NDArray[np.float64]
    O_F_ext_hat_K: NDArray[np.float64]

    @classmethod
    def empty(cls) -> "ArmState":
        """Return a state of zeros with valid transforms and mode OTHER."""
        record = np.zeros(1, ARM_STATE)
        record["O_T_EE"][0] = np.eye(4)
        return cls(record, *(record[field.name][0] for field in fields(cls) if field.name != "record"))

    @property
    def t_ns(self) -> int:
        """Robot's time, ns."""
        return int(self.record["t_ns"][0])

    @property
    def robot_mode(self) -> RobotMode:
        """What the robot is doing."""
        return RobotMode(int(self.record["robot_mode"][0]))

    @property
    def current_errors(self) -> int:
        """Bit mask of the active errors."""
        return int(self.record["current_errors"][0])
