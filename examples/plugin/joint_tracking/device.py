"""An input device without hardware: it closes the pads, opens them again, and ends the recording."""

import time

from rtstack.teleoperation.device import HandInput

CLOSE_S, OPEN_S = 1.0, 2.0


class ScriptedDevice:
    """An rtstack.teleoperation.device.InputDevice. argument: the deflection, 0 to 1 of the chosen speed."""

    def __init__(self, argument: str) -> None:
        self._deflection = float(argument or 0.5)
        self._began_s = time.monotonic()

    def read(self) -> HandInput:
        """Return what the operator does now."""
        t_s = time.monotonic() - self._began_s
        inwards = self._deflection if t_s < CLOSE_S else -self._deflection
        left, right = (0.0, -inwards, 0.0, 0.0, 0.0, 0.0), (0.0, inwards, 0.0, 0.0, 0.0, 0.0)
        return HandInput(held=t_s < OPEN_S, left=left, right=right, finished=t_s >= OPEN_S)

    def close(self) -> None:
        """Release the device."""
