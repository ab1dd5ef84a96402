"""Faults of motion capture: a tracker that is blind for a while, or repeats itself."""

from collections.abc import Callable

from hal.tracker import ObjectPose
from sim_robot.tracker import SimulatedTracker


class FaultyTracker:
    """A simulated tracker as it is seen through faults. blind: no new frames; frozen: the last pose at new times."""

    def __init__(self, inner: SimulatedTracker, blind: Callable[[], bool], frozen: Callable[[], bool]) -> None:
        self._inner, self._blind, self._frozen = inner, blind, frozen
        self._seen, self._given = ObjectPose.empty(), ObjectPose.empty()
        self._frame_t_ns = -1

    def update(self) -> None:
        """Look at the object when a frame is due. The cell calls it once a millisecond."""
        self._inner.update()
        new = self._inner.latest()
        if new.t_ns == self._frame_t_ns:
            return
        self._frame_t_ns = new.t_ns
        if self._blind():
            return
        if self._frozen() and self._seen.record["seen"][0]:
            self._seen.record["t_ns"] = new.record["t_ns"]
        else:
            self._seen.record[:] = new.record

    def latest(self) -> ObjectPose:
        """Return the newest frame. It belongs to the tracker and is overwritten by the next call."""
        self._given.record[:] = self._seen.record
        return self._given
