"""State of an arm, with libfranka's names, as one fixed-size record.

One record is one contiguous block: the loop copies it in one go, compiled code indexes it by name, the log's
schema is made from it.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray


class RobotMode(IntEnum):
    """libfranka's RobotMode."""

    OTHER = 0
    IDLE = 1
    MOVE = 2
    GUIDING = 3
    REFLEX = 4
    USER_STOPPED = 5
    AUTOMATIC_ERROR_RECOVERY = 6


# Shapes and units: joints (7,) in rad, rad/s, Nm; O_T_EE (4, 4) row-major here, column-major on the wire and in the
# log (libfranka's layout); O_F_ext_hat_K (6,) = force N, torque Nm about the stiffness frame K (here the pad's face),
# along the axes of the base O, positive where the robot pushes the environment. tau_J includes gravity, tau_J_d
# excludes it. tau_ext_hat_filtered has the sign of the wrench. current_errors is a bit mask, see hal.robot_errors.
ARM_STATE = np.dtype(
    [
        ("t_ns", "i8"),
        ("q", "f8", 7),
        ("dq", "f8", 7),
        ("tau_J", "f8", 7),
        ("tau_J_d", "f8", 7),
        ("dtau_J", "f8", 7),
        ("theta", "f8", 7),
        ("dtheta", "f8", 7),
        ("tau_ext_hat_filtered", "f8", 7),
        ("O_T_EE", "f8", (4, 4)),
        ("O_F_ext_hat_K", "f8", 6),
        ("control_command_success_rate", "f8"),
        ("robot_mode", "i8"),
        ("current_errors", "i8"),
    ]
)


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
        return cls(
            record=record,
            q=record["q"][0],
            dq=record["dq"][0],
            tau_J=record["tau_J"][0],
            tau_ext_hat_filtered=record["tau_ext_hat_filtered"][0],
            O_T_EE=record["O_T_EE"][0],
            O_F_ext_hat_K=record["O_F_ext_hat_K"][0],
        )

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
