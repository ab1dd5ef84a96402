"""Everything that a run published, kept in memory: what a result is computed from, as a log gives it back."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from hal.compilation import bound, compiled
from rtstack.log.push import copy_bytes
from rtstack.samples import ARM_SAMPLE, CONTROL_SAMPLE, SIDES, TIMING_SAMPLE
from rtstack.topics import ARM_TOPICS, CONTROL_TOPICS, EVENT_TOPIC, OBJECT_TOPIC, TIMING_TOPIC, TOPICS

EVENTS = 1024  # that are kept: a trial has some ten


@dataclass(frozen=True, slots=True)
class Columns:
    """Samples of a run: arm and control (arms, n), timing (n,), object (m,), of the records of rtstack.samples."""

    arm: NDArray[np.void]
    control: NDArray[np.void]
    timing: NDArray[np.void]
    object: NDArray[np.void]

    @classmethod
    def read(cls, topic: Callable[[str], NDArray[np.void]]) -> "Columns":
        """Return the samples that `topic` has of each of the topics, cut to the shortest of a tick. An arm of which
        there is no sample was not there; without any there are two."""
        arms, controls = ([topic(name) for name in names] for names in (ARM_TOPICS, CONTROL_TOPICS))
        there = [k for k, samples in enumerate(arms) if len(samples)] or [0, 1]
        arms, controls = [arms[k] for k in there], [controls[k] for k in there]
        timing = topic(TIMING_TOPIC)
        n = min(map(len, (*arms, *controls, timing)))
        arm, control = (np.stack([samples[:n] for samples in sides]) for sides in (arms, controls))
        return cls(arm, control, timing[:n], topic(OBJECT_TOPIC))


@compiled("void(int64[:, ::1], int64)")
def _append(rows, k):
    """Copy record k of each of rows (n, 3): address of the memory, bytes a record, address of the source."""
    for i in range(len(rows)):
        target = rows[i, 0] + k * rows[i, 1]
        copy_bytes(target, rows[i, 2], rows[i, 1])  # pyright: ignore[reportCallIssue] (numba passes its context)


class _Samples:
    """Preallocated memory for samples (..., capacity) of a record. endless: the newest are kept, else the first."""

    def __init__(self, shape: tuple[int, ...], record: np.dtype, endless: bool) -> None:
        self.memory = np.zeros(shape, record)
        # zeros that were never accessed are no memory yet: the kernel would clear 2 MB in the middle of a tick (8 ms)
        self.memory.view(np.uint8).fill(0)
        self._endless = endless
        self._count = 0

    def take(self, sample: NDArray) -> None:
        """Copy a sample, (1,), of samples (capacity,)."""
        if self._count < len(self.memory) or self._endless:
            self.memory[self._count % len(self.memory)] = sample[0]
            self._count += 1

    def taken(self, count: int | None = None) -> NDArray:
        """Return what was taken, oldest first; count: how many there were, where they came in another way."""
        count, n = self._count if count is None else count, self.memory.shape[-1]
        return self.memory[..., :count] if count <= n else np.roll(self.memory, -(count % n), axis=-1)


class History:
    """Preallocated memory for a run of at most `capacity` ticks: `append` copies and never allocates. endless: of a run
    that has no length of its own the newest `capacity` ticks are kept."""

    def __init__(self, capacity: int, endless: bool = False, sides: Sequence[str] = SIDES) -> None:
        self._capacity, self._endless, self._sides = capacity, endless, sides
        self._arm = _Samples((len(sides), capacity), ARM_SAMPLE, endless)
        self._control = _Samples((len(sides), capacity), CONTROL_SAMPLE, endless)
        self._timing = _Samples((capacity,), TIMING_SAMPLE, endless)
        self._others = {EVENT_TOPIC: _Samples((EVENTS,), TOPICS[EVENT_TOPIC].record, False)}
        self.keep(OBJECT_TOPIC)
        self._sources: tuple[NDArray, ...] = ()
        self._records: Sequence[tuple[NDArray, NDArray]] | None = None
        self._copy: Callable[[int], None] = lambda _k: None
        self._ticks = 0

    def keep(self, topic: str) -> Callable[[NDArray], None]:
        """Make room for a topic that is not of the ticks, at most a sample a tick; return what takes a sample, (1,)."""
        if topic not in self._others:
            self._others[topic] = _Samples((self._capacity,), TOPICS[topic].record, self._endless)
        return self._others[topic].take

    def append(self, records: Sequence[tuple[NDArray, NDArray]], timing: NDArray) -> None:
        """Take each arm's arm and control records and the timing, (1,) each. Beyond the capacity: see the class."""
        k = self._ticks
        if k >= self._capacity:
            if not self._endless:
                return
            k %= self._capacity
        if records is not self._records:
            # the loop publishes the same arrays every tick: their places are looked up once
            self._records = records
            self._bind((*chain.from_iterable(records), timing))
        self._copy(k)
        self._ticks += 1

    def _bind(self, sources: tuple[NDArray, ...]) -> None:
        """Look up where the records (1,) are, and where they go. Raises TypeError for a record of another dtype."""
        arm, control = self._arm.memory, self._control.memory
        targets = (*chain.from_iterable(zip(arm, control, strict=True)), self._timing.memory)
        for source, target in zip(sources, targets, strict=True):
            if source.dtype != target.dtype or source.shape != (1,):
                raise TypeError(f"a record of shape (1,) and dtype {target.dtype} is needed, not {source.dtype}")
        self._sources = sources
        rows = [(t.ctypes.data, t.itemsize, s.ctypes.data) for s, t in zip(sources, targets, strict=True)]
        self._copy = bound(_append, np.array(rows, np.int64), later=(0,))

    @property
    def ticks(self) -> int:
        """Number of ticks that were taken, kept or not."""
        return self._ticks

    def columns(self) -> Columns:
        """Return what was taken, oldest first: views, copies where an endless run has gone round."""
        arm, control, timing = (samples.taken(self._ticks) for samples in (self._arm, self._control, self._timing))
        return Columns(arm, control, timing, self._others[OBJECT_TOPIC].taken())

    def batches(self) -> dict[str, NDArray]:
        """Return what was taken by topic, in the order of the table, as `columns` does."""
        columns = self.columns()
        of_ticks = (*columns.arm, *columns.control, columns.timing)
        there = [SIDES.index(side) for side in self._sides]
        names = (*(topics[k] for topics in (ARM_TOPICS, CONTROL_TOPICS) for k in there), TIMING_TOPIC)
        found = dict(zip(names, of_ticks, strict=True))
        found |= {topic: samples.taken() for topic, samples in self._others.items()}
        return {topic: found[topic] for topic in TOPICS if topic in found}
