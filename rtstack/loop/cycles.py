"""When each arm's states came and were answered, where the arms have clocks of their own: into the log, each cycle."""

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from numpy.typing import NDArray

from hal.cycle import Cycles
from hal.host_work import HostWork
from rtstack.loop.publisher import Publisher


class CycleReporter:
    """Publishes the cycles of both arms, and what the host did meanwhile. cycles: None where they are not measured;
    stamps: t_ns of both arms' present states, (1,) each."""

    def __init__(
        self, cycles: tuple[Cycles, Cycles] | None, stamps: Sequence[NDArray[Any]], publisher: Publisher
    ) -> None:
        self._arms = [(cycle, cycle.sample["t_ns"], stamp) for cycle, stamp in zip(cycles or (), stamps, strict=False)]
        self._work, self._publisher = HostWork(), publisher

    def measuring(self) -> AbstractContextManager[object]:
        """Return the context in which the host's work for the calling thread is counted."""
        return self._work if self._arms else nullcontext()

    def tick(self, sides: tuple[int, ...]) -> None:
        """Publish the cycles of the arms that were just answered."""
        if not self._arms:
            return
        work = self._work
        for k in sides:
            cycles, own_stamp, stamp = self._arms[k]
            own_stamp[0] = stamp[0]
            read = work.cycle(cycles.late)
            if read:
                work.sample["t_ns"][0] = own_stamp[0]
            self._publisher.cycle(k, cycles.sample, work.sample if read else None)
