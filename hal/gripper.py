"""The gripper: what a hand on an arm's flange can do. Its commands block; nothing here belongs to the tick."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class GripperState:
    """What a hand reports. t_ns: since the robot's start; widths between the fingers, m; deg C.

    max_width: 0 until the first homing.
    """

    t_ns: int
    width: float
    max_width: float
    is_grasped: bool
    temperature: int


class Gripper(Protocol):
    """One hand with two fingers. Units m, m/s, N.

    Every command raises ConnectionLost when the hand does not answer, GripperFailed when it refuses (never homed, a
    width outside 0 and max_width, a speed or force that is not positive), GripperAborted when stop or another command
    ended it.
    """

    def state(self) -> GripperState:
        """Block until the next state, a tenth of a second at most, and return it. Raises ConnectionLost."""
        ...

    def homing(self) -> bool:
        """Find the largest width: once after switching on, and after a change of fingers. Returns whether it did."""
        ...

    def move(self, width: float, speed: float) -> bool:
        """Bring the fingers to a width. Returns whether they got there: where something is between them they do not."""
        ...

    def grasp(
        self, width: float, speed: float, force: float, epsilon_inner: float = 0.005, epsilon_outer: float = 0.005
    ) -> bool:
        """Close until `force` is felt, and hold on. Returns whether the fingers then are at the object's width:
        width - epsilon_inner < d < width + epsilon_outer. Where they are not the hand lets go.
        """
        ...

    def stop(self) -> bool:
        """End the command that runs, and let go."""
        ...

    def close(self) -> None:
        """Release the connection; what is held stays held. Never raises, may be called twice."""
