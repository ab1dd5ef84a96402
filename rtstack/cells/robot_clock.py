"""How the robot's time is the host's and Unix time, from the states' arrival: a topic of the log."""

import time
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hal.clock_relation import ClockRelation
from rtstack.topics import CLOCK_TOPIC

if TYPE_CHECKING:
    from hal.fci import FciPair

EVERY_NS = 100_000_000


class RobotClock:
    """Relates the time of the first arm's states, which are the beat, to the host's; a hal.sensor.Sensor of that."""

    topic = CLOCK_TOPIC

    def __init__(self, pair: "FciPair", relation: ClockRelation) -> None:
        """relation: of the robot's time (a) and time.monotonic_ns (b)."""
        self._pair, self._relation = pair, relation
        self._first = next(iter(pair.arms.values()))
        self._t_ns, self._said_ns = self._first.t_ns, -EVERY_NS

    def wait(self) -> int:
        """See hal.cell.ArmLink. The state that was waited for before has been read by now."""
        # now, not when it arrived: the state that is read may be a later one than that which was waited for
        t_ns = self._first.t_ns
        if t_ns != self._t_ns:
            self._relation.update(t_ns, time.monotonic_ns())
        self._t_ns = t_ns
        return self._pair.wait()

    def read(self, sample: NDArray[np.void]) -> None:
        """See hal.sensor.Sensor: ten times a second, once two blocks of states have said how far a line holds."""
        t_ns, relation = self._t_ns, self._relation
        if relation.blocks < 2 or 0 <= t_ns - self._said_ns < EVERY_NS:
            return
        self._said_ns = t_ns
        sample["t_ns"] = t_ns
        sample["unix_ns"] = relation.b_of(t_ns) + time.time_ns() - time.monotonic_ns()
        sample["drift_ppm"] = relation.drift_ppm
        sample["uncertainty_us"] = 1e-3 * relation.rms_ns
        sample["steps"] = relation.resets
