"""A sensor of the cell beside its arms and its tracker: what it measures is a topic of the log."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Sensor(Protocol):
    """A source of samples at up to 1 kHz."""

    @property
    def topic(self) -> str:
        """The topic of its samples, as the topic table has it (rtstack.topics): /left/wrench_sensor."""
        ...

    def read(self, sample: NDArray[np.void]) -> None:
        """Write the newest sample, (1,), of the topic's record; t_ns is the robot's time in ns; one whose t_ns is the
        last one's is not published again.

        Called once a tick: it must not block, wait, allocate or raise, and leaves the sample alone (t_ns is -1) until
        there is one.
        """
