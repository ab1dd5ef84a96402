"""Input devices that move the arms: what one of them says, and those that packages offer by name."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, cast

from hal.extensions import ExtensionPoint
from rtstack.samples import SIDES

Six = tuple[float, float, float, float, float, float]
"""A deflection, -1 to 1 of the chosen speed, along the world's axes and about them."""
Pose = tuple[float, float, float, float, float, float, float]
"""Position m and quaternion wxyz, in the world."""


@dataclass(frozen=True, slots=True)
class HandInput:
    """What an operator does now. held: the clutch; without it nothing moves.

    left, right: a pose (position m, quaternion wxyz, in the world), or a deflection (-1 to 1 of the chosen speed, along
    the world's axes and about them); None for an arm that stays, or is not there. finished: the operator has ended the
    teleoperation. leading: the poses are of a person's hands, or a leader's: each pad goes as its hand goes, from where
    both were when the clutch began to be held. tracked: False where the device does not see a hand that it says to be
    held. sensed: of left and right, the poses from which the others are made by a filter or a scale, None for the same.
    A hand that moves as none can (rtstack.teleoperation.hand_motion) is let go, until the clutch was let go too.
    """

    held: bool
    left: Pose | Six | None = None
    right: Pose | Six | None = None
    finished: bool = False
    leading: bool = False
    tracked: bool = True
    sensed: tuple[Pose | None, Pose | None] = (None, None)

    def message(self) -> dict[str, Any]:
        """Return the message to the console (POST /api/teleoperation/hand)."""
        message: dict[str, Any] = {"clutch": self.held}
        for side, values in (("left", self.left), ("right", self.right)):
            if self.held and values is not None:
                kind = "deflection" if len(values) != 7 else "hands" if self.leading else "pose"
                message.setdefault(kind, {})[side] = list(values)
        if self.held and not self.tracked:
            message["tracked"] = False
        if self.held and any(self.sensed):
            message["sensed"] = dict(zip(SIDES, self.sensed, strict=True))
        return message


class InputDevice(Protocol):
    """An open device. `read` is called 50 times a second, outside the real-time loop, in one thread."""

    def read(self) -> HandInput:
        """Return what the operator does now. Waits for nothing: 0.3 s without an answer stop the arms."""
        ...

    def close(self) -> None:
        """Release the device. Never raises."""


# each a callable (argument: str) -> InputDevice; argument: what stands behind NAME: on the command line, "" for nothing
DEVICES = ExtensionPoint[Callable[[str], InputDevice]](
    "rtstack.devices", "input device", cast(Any, Callable), ours=False
)
