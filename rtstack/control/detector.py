"""Impact detector of Appendix B: three conditions on the estimated external force and the velocity a moment ago.

The robot's estimate is not zero where nothing touches the pad: payload, gravity and friction are never known exactly.
An offset of 4 N makes the paper's law blind. So the force is counted from its own mean over the window (the tare),
until an impact is near, or there: a mean below `tare_n` is left out, and the law is the paper's.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hal.base.arrays import numbers
from hal.compilation import compiled
from rtstack.control.parameters import DetectorParameters

FORCE, VELOCITY = 0, 3  # columns of the history
LONGEST_WINDOW = 1_000_000  # samples: 48 MB
_BOUNDS = ("force_low_n", "force_high_n", "velocity_m_s", "tare_n", "largest_tare_n")


@compiled
def impact_now(force, velocity, memory, force_low, force_high, velocity_bound, tare_from, tare_to):
    """Push f and v into the history of one arm and return whether 1)-3) hold now, with f counted from the tare.

    force (3,) N is the force that acts ON the end effector, velocity (3,) m/s; memory: DetectorMemory.
    """
    history, total, tare = memory.history, memory.total, memory.tare
    window = history.shape[0]
    k = memory.head[0]
    hit = False
    if memory.filled[0] >= window:
        if memory.frozen[0] == 0:
            size = math.sqrt(total[0] ** 2 + total[1] ** 2 + total[2] ** 2) / window
            for i in range(3):
                tare[i] = total[i] / window if tare_from <= size <= tare_to else 0.0
        past = history[k]
        squares = past_squares = against = 0.0
        for i in range(3):
            now, before = force[i] - tare[i], past[i] - tare[i]
            squares += now**2
            past_squares += before**2
            against += past[VELOCITY + i] * now
        norm = math.sqrt(squares)
        hit = math.sqrt(past_squares) < force_low and norm > force_high and against < -velocity_bound * norm
        for i in range(3):
            total[i] -= past[i]
        if hit:
            memory.frozen[0] = 1
    else:
        memory.filled[0] += 1
    for i in range(3):
        history[k, FORCE + i], history[k, VELOCITY + i] = force[i], velocity[i]
        total[i] += force[i]
    memory.head[0] = (k + 1) % window
    return hit


class DetectorMemory(NamedTuple):
    """History (window, 6) of f N and v m/s; head (1,): the row of the oldest; filled (1,): rows in use; total (3,) N:
    the sum of the forces in it; tare (3,) N: what the force is counted from; frozen (1,): if it stays."""

    history: NDArray[np.float64]
    head: NDArray[np.int64]
    filled: NDArray[np.int64]
    total: NDArray[np.float64]
    tare: NDArray[np.float64]
    frozen: NDArray[np.int64]


class ImpactDetector:
    """The detector of one end effector, of any robot. The same one runs online and on a recording.

    Args:
        parameters: Bounds and length of the window, in N, m/s and s.
        period_s: Time between two updates, s.

    Raises:
        TypeError: Parameters of another kind.
        ValueError: One line: what does not fit.
    """

    def __init__(self, parameters: DetectorParameters, period_s: float) -> None:
        if not isinstance(parameters, DetectorParameters):
            raise TypeError(f"parameters: expected DetectorParameters, found {type(parameters).__name__}")
        self._bounds = tuple(float(numbers(getattr(parameters, name), name, (), finite=False)) for name in _BOUNDS)
        window_s, period = (float(numbers(value, "period_s", ())) for value in (parameters.window_s, period_s))
        window = window_s / period if period > 0.0 else 0.0
        if not 1.0 <= window <= LONGEST_WINDOW:
            raise ValueError(f"period_s: expected 1 to {LONGEST_WINDOW} in a window of {window_s} s, found {period_s}")
        history = np.zeros((round(window), 6))
        whole = (np.zeros(1, np.int64) for _ in range(3))
        # for compiled code that updates it itself
        self.memory = DetectorMemory(history, next(whole), next(whole), np.zeros(3), np.zeros(3), next(whole))

    def update(self, force: ArrayLike, velocity: ArrayLike) -> bool:
        """Take a sample and return whether it was hit.

        Args:
            force: That acts ON the end effector (3,) N.
            velocity: Of the end effector, along the same axes (3,) m/s.

        Raises:
            ValueError: Not three finite numbers; the sample was not taken.
        """
        f, v = numbers(force, "force", (3,)), numbers(velocity, "velocity", (3,))
        return bool(impact_now(f, v, self.memory, *self._bounds))
