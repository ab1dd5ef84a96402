"""Everything that a run published, kept in memory: what a result is computed from, as a log gives it back."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hal.compilation import compiled
from hal.tracker import OBJECT_POSE
from rtstack.log.push import copy_bytes
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, EVENT, TIMING_SAMPLE

EVENTS = 1024  # that are kept: a trial has some ten


@dataclass(frozen=True, slots=True)
class Columns:
    """Samples of a run: arm and control (2, n), timing (n,), object (m,), of the records of rtstack.samples."""

    arm: NDArray
    control: NDArray
    timing: NDArray
    object: NDArray


@compiled("void(int64[:, ::1], int64)")
def _append(rows, k):
    """Copy record k of each of rows (n, 3): address of the memory, bytes a record, address of the source."""
    for i in range(len(rows)):
        target = rows[i, 0] + k * rows[i, 1]
        copy_bytes(target, rows[i, 2], rows[i, 1])  # pyright: ignore[reportCallIssue] (numba passes its context)


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
        self._events = np.zeros(EVENTS, EVENT)
        self._sources: tuple[NDArray, ...] = ()
        self._left: tuple[NDArray, NDArray] | None = None
        self._rows = np.zeros((0, 3), np.int64)
        self._capacity = capacity
        self._ticks = 0
        self._poses = 0
        self._said = 0
        # zeros that nobody has touched are no memory yet: the kernel would clear 2 MB in the middle of a tick (8 ms)
        for array in (self._arm, self._control, self._timing, self._object):
            array.view(np.uint8).fill(0)

    def append(self, left: tuple[NDArray, NDArray], right: tuple[NDArray, NDArray], timing: NDArray) -> None:
        """Take both arms' arm and control records and the timing, (1,) each. Beyond the capacity: see the class."""
        k = self._ticks
        if k >= self._capacity:
            if not self._endless:
                return
            k %= self._capacity
        if left is not self._left:
            # the loop publishes the same arrays every tick: their places are looked up once
            self._left = left
            self._bind((*left, *right, timing))
        _append(self._rows, k)
        self._ticks += 1

    def _bind(self, sources: tuple[NDArray, ...]) -> None:
        """Look up where the records (1,) are, and where they go. Raises TypeError for a record of another dtype."""
        targets = (self._arm[0], self._control[0], self._arm[1], self._control[1], self._timing)
        for source, target in zip(sources, targets, strict=True):
            if source.dtype != target.dtype or source.shape != (1,):
                raise TypeError(f"a record of shape (1,) and dtype {target.dtype} is needed, not {source.dtype}")
        self._sources = sources
        rows = [(t.ctypes.data, t.itemsize, s.ctypes.data) for s, t in zip(sources, targets, strict=True)]
        self._rows = np.array(rows, np.int64)

    def append_pose(self, pose: NDArray) -> None:
        """Take an object pose, (1,)."""
        if self._poses < len(self._object) or self._endless:
            self._object[self._poses % len(self._object)] = pose[0]
            self._poses += 1

    def append_event(self, event: NDArray) -> None:
        """Take an event, (1,). Beyond the first EVENTS none is kept."""
        if self._said < EVENTS:
            self._events[self._said] = event[0]
            self._said += 1

    @property
    def events(self) -> NDArray:
        """The events that were taken, a view."""
        return self._events[: self._said]

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
