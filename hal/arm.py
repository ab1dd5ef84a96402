"""The arm: five verbs, torque only. The robot is the clock."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hal.state import ArmState


class Arm(Protocol):
    """One torque-controlled arm.

    Real-time side: `read` and `write`, in turn, once a millisecond, from one thread. An adapter sends what it is given:
    it never clips, filters or repairs a torque.
    """

    def read(self) -> ArmState:
        """Block until the next state and return it. The state belongs to the arm and is overwritten by the next read.

        Raises ConnectionLost when the arm does not answer, CommandRejected when the arm has left torque control.
        """
        ...

    def write(self, tau: NDArray[np.float64]) -> None:
        """Answer the last state with a torque, shape (7,), Nm, gravity excluded. Does not block.

        Raises CommandRejected when the arm has left torque control.
        """

    def stop(self) -> None:
        """End torque control: the arm holds with its own brakes and controllers. Never raises, may be called twice."""

    def recover(self) -> None:
        """Clear a latched error. Raises RecoveryRefused while its cause persists."""

    def close(self) -> None:
        """Stop, and release the connection. Never raises, may be called twice."""
