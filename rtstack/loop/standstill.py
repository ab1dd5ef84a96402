"""When the arms have come to rest after a stop."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

REST_DQ = 0.02  # rad/s: below it for REST_TICKS the arms are at rest
REST_TICKS = 50
STOP_TICKS = 1000  # a stop from the velocity limit takes 0.5 s at 10 rad/s^2; after twice that the session ends anyhow


class StandstillDetector:
    """Counts the ticks of a stop. velocities: each arm's dq (7,), rad/s, as its sample shows it."""

    def __init__(self, velocities: Sequence[NDArray[np.float64]]) -> None:
        self._velocities = tuple(velocities)
        self._quiet = 0
        self._ticks = 0
        self.fastest = 0.0  # rad/s, of the last tick

    def over(self) -> bool:
        """Count a tick of the stop; return whether it was the last one."""
        self._ticks += 1
        self.fastest = max(float(np.max(np.abs(dq))) for dq in self._velocities)
        self._quiet = self._quiet + 1 if self.fastest < REST_DQ else 0
        return self.reached or self._ticks >= STOP_TICKS

    @property
    def reached(self) -> bool:
        """Whether the arms are at rest."""
        return self._quiet >= REST_TICKS
