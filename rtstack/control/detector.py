"""Impact detector of Appendix B: three conditions on the estimated external force and the velocity a moment ago."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hal.compilation import compiled
from rtstack.control.parameters import DetectorParameters


@compiled
def impact_now(force, velocity, history, head, count, force_low, force_high, velocity_bound):
    """Push (|f|, v) into the history of one arm and return whether 1)-3) hold now.

    force (3,) N is the force that acts ON the end effector, velocity (3,) m/s; history (window, 4); head and count
    (1,).
    """
    window = history.shape[0]
    norm = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
    k = head[0]
    hit = False
    if count[0] >= window:
        past = history[k]
        against = past[1] * force[0] + past[2] * force[1] + past[3] * force[2]
        hit = past[0] < force_low and norm > force_high and against < -velocity_bound * norm
    else:
        count[0] += 1
    history[k, 0] = norm
    history[k, 1] = velocity[0]
    history[k, 2] = velocity[1]
    history[k, 3] = velocity[2]
    head[0] = (k + 1) % window
    return hit


class DetectorMemory(NamedTuple):
    """History (window, 4) of |f| N and v m/s, the place of the oldest (1,), and how many there are (1,)."""

    history: NDArray[np.float64]
    head: NDArray[np.int64]
    count: NDArray[np.int64]


class ImpactDetector:
    """The detector of one arm. The same one runs online and on a recording."""

    def __init__(self, parameters: DetectorParameters, period_s: float) -> None:
        self._parameters = parameters
        self._history = np.zeros((round(parameters.window_s / period_s), 4))
        self._head = np.zeros(1, np.int64)
        self._count = np.zeros(1, np.int64)

    @property
    def memory(self) -> DetectorMemory:
        """For compiled code that updates it itself."""
        return DetectorMemory(self._history, self._head, self._count)

    def reset(self) -> None:
        """Forget everything: nothing is detected before the window is full again."""
        self._head[0] = 0
        self._count[0] = 0

    def update(self, force: NDArray[np.float64], velocity: NDArray[np.float64]) -> bool:
        """Take the force ON the end effector (3,) N and its velocity (3,) m/s; return whether it was hit."""
        p = self._parameters
        return impact_now(
            force, velocity, self._history, self._head, self._count, p.force_low_n, p.force_high_n, p.velocity_m_s
        )
