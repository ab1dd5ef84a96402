"""How long a hand takes to reach the torque, and a torque to reach the picture: of the last applied commands."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from rtstack.log.ring import Rings
from rtstack.topics import HAND_TOPIC

_COMMANDS = 200  # that figures are made of


@dataclass(frozen=True, slots=True)
class LatencyView:
    """Median and 95th percentile, ms: from a command's making to its torque, and from the robot state of the picture
    that it answers to that picture being seen.
    """

    to_torque_ms: tuple[float, float]
    to_picture_ms: tuple[float, float]


class Latency:
    """Reads what the loop says of the commands that it has applied. Not for two threads at a time."""

    def __init__(self, rings: Rings) -> None:
        self._reader = rings.reader(HAND_TOPIC)
        self._seen: deque[tuple[float, float]] = deque(maxlen=_COMMANDS)
        self._view: LatencyView | None = None

    def forget(self) -> None:
        """Begin anew."""
        self._reader.drain()
        self._seen.clear()
        self._view = None

    def view(self) -> LatencyView | None:
        """Return the figures, None before the first command."""
        new = self._reader.drain()
        if len(new):
            self._seen.extend(zip(new["made_us"], new["picture_us"] - new["seen_us"], strict=True))
            low, high = np.percentile(np.array(self._seen) * 1e-3, (50, 95), axis=0).round(1).tolist()
            self._view = LatencyView((low[0], high[0]), (low[1], high[1]))
        return self._view
