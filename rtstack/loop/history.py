"""Everything that a run published, kept in memory: what a result is computed from, as a log gives it back."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.tracker import OBJECT_POSE
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, TIMING_SAMPLE


@dataclass(frozen=True, slots=True)
class Columns:
    """Samples of a run: arm and control (2, n), timing (n,), object (m,), of the records of rtstack.samples."""

    arm: NDArray
    control: NDArray
    timing: NDArray
    object: NDArray


class History:
    """Preallocated memory for a run of at most `capacity` ticks: `append` copies and never allocates.

    endless: of a run that has no length of its own the newest `capacity` ticks are kept.
    """

    def __init__(self, capacity: int, endless: bool = False) -> None:
        self._endless = endless
        self._arm = np.zeros((2, capacity), ARM_SAMPLE)
        self._control = np.zeros((2, capacity), CONTROL_SAMPLE)
        self._timing = np.zeros(capacity, TIMING_SAMPLE)
        self._object = np.zeros(capacity, OBJECT_POSE)
        # bytes of a record a row: copying bytes costs a tenth of copying fields
        self._arm_bytes = self._arm.view(np.uint8).reshape(2, capacity, -1)
        self._control_bytes = self._control.view(np.uint8).reshape(2, capacity, -1)
        self._sources: tuple[NDArray, ...] | None = None
        self._ticks = 0
        self._poses = 0
        # zeros that nobody has touched are no memory yet: the kernel would clear 2 MB in the middle of a tick (8 ms)
        for array in (self._arm, self._control, self._timing, self._object):
            array.view(np.uint8).fill(0)

    def append(self, left: tuple[NDArray, NDArray], right: tuple[NDArray, NDArray], timing: NDArray) -> None:
        """Take both arms' arm and control records and the timing, (1,) each. Beyond the capacity: see the class."""
        k, capacity = self._ticks, len(self._timing)
        if k >= capacity:
            if not self._endless:
                return
            k %= capacity
        if self._sources is None or self._sources[0] is not left[0]:
            # the loop publishes the same arrays every tick: their bytes are looked up once
            self._sources = (left[0], *(record.view(np.uint8) for record in (*left, *right)))
        _, left_arm, left_control, right_arm, right_control = self._sources
        self._arm_bytes[0, k] = left_arm
        self._control_bytes[0, k] = left_control
        self._arm_bytes[1, k] = right_arm
        self._control_bytes[1, k] = right_control
        self._timing[k] = timing[0]
        self._ticks += 1

    def append_pose(self, pose: NDArray) -> None:
        """Take an object pose, (1,)."""
        if self._poses < len(self._object) or self._endless:
            self._object[self._poses % len(self._object)] = pose[0]
            self._poses += 1

    @property
    def ticks(self) -> int:
        """Number of ticks that were taken, kept or not."""
        return self._ticks

    def columns(self) -> Columns:
        """Return what was taken, oldest first: views, copies where an endless run has gone round."""
        return Columns(
            arm=_in_order(self._arm, self._ticks),
            control=_in_order(self._control, self._ticks),
            timing=_in_order(self._timing, self._ticks),
            object=_in_order(self._object, self._poses),
        )


def _in_order(records: NDArray, count: int) -> NDArray:
    """Return the records (..., n) that were written, of which there were `count`."""
    n = records.shape[-1]
    return records[..., :count] if count <= n else np.roll(records, -(count % n), axis=-1)
