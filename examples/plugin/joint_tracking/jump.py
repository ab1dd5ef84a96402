"""An impact detector: the momentum observer's residual jumps by more than free motion ever makes it."""

import numpy as np

from rtstack.control.controller import ObservedArm

JUMP_NM_S = 2000.0  # twice the simulated arm's largest rate in free motion, half of that of a grab at 0.3 m/s
QUIET_S = 0.05  # a second jump within this time belongs to the same impact


class ResidualJump:
    """An rtstack.control.controller.Detector: the rate of the residual's norm passes a threshold."""

    def __init__(self, arm: ObservedArm) -> None:
        self._rate = arm.control[0]["residual_rate"]
        self._quiet, self._since = round(QUIET_S / arm.parameters.period_s), 0

    def update(self, arm: ObservedArm) -> bool:
        """Return whether the pad was hit in this tick."""
        self._since += 1
        hit = bool(np.dot(self._rate, self._rate) > JUMP_NM_S**2) and self._since > self._quiet
        if hit:
            self._since = 0
        return hit
