"""The instants at which a log shows the cell, 50 a second of the robot's time, and what was known at each of them."""

from dataclasses import dataclass

import numpy as np
from foxglove.messages import Timestamp
from numpy.typing import NDArray

from rtstack.samples import SIDES

PERIOD_NS = 20_000_000
OBJECT = "object"
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Known:
    """What was known of an arm or of the object: at which of the instants, (m,), and the newest records then, (m,)."""

    rows: NDArray[np.intp]
    records: NDArray


@dataclass(frozen=True, slots=True)
class Instants:
    """Instants (n,), ns, and what was known then of left, right and object; what was never seen is left out."""

    t_ns: NDArray[np.int64]
    known: dict[str, Known]

    def stamps(self, rows: NDArray[np.intp] | None = None) -> list[Timestamp]:
        return [stamp(t) for t in (self.t_ns if rows is None else self.t_ns[rows]).tolist()]


def stamp(t_ns: int) -> Timestamp:
    """Return a time as a time stamp; what was before the robot's zero is at zero."""
    t_ns = max(t_ns, 0)
    return Timestamp(t_ns // _NS, t_ns % _NS)


class InstantFinder:
    """Finds the instants in a run's batches of arm samples and object poses."""

    def __init__(self) -> None:
        self._next_ns: int | None = None
        self._held: dict[str, NDArray] = {}  # of each arm, and of the object: the newest record of the batches so far

    def find(self, arms: dict[str, NDArray], poses: NDArray) -> Instants:
        """Return the instants in a batch of ARM_SAMPLE records of each side and OBJECT_POSE records.

        The first side that has samples sets the times; everything else is the newest that was seen until then.
        """
        leader = next((arms[side] for side in SIDES if len(arms[side])), arms[SIDES[0]])
        due = np.array(self._due(leader["t_ns"]), np.int64)
        found: dict[str, Known] = {}
        for name, records in (*((side, arms[side]) for side in SIDES), (OBJECT, poses)):
            held = self._held.get(name, records[:0])
            known = np.concatenate([held, records]) if len(held) else records
            self._held[name] = known[-1:].copy()
            count = np.maximum(np.searchsorted(known["t_ns"], due, side="right"), len(held))
            seen = np.flatnonzero(count)
            if len(seen):
                found[name] = Known(seen, known[count[seen] - 1])
        return Instants(due, found)

    def _due(self, t_ns: NDArray[np.int64]) -> list[int]:
        times = []
        for t in t_ns.tolist():
            if self._next_ns is None or t >= self._next_ns:
                times.append(t)
                self._next_ns = (t // PERIOD_NS + 1) * PERIOD_NS
        return times
