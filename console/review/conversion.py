"""A process of its own: reads a log once, from its start to its end, and writes its columns.

    python -m console.review.conversion LOG.mcap FOLDER

The index in the folder grows with every batch, so that a page shows the beginning while the rest is being read.
"""

import os
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from console.child_process import MEMORY_GB, stand_back
from console.review.columns import ColumnWriter, Index, Mark
from rtstack.log.analysis.derived import DERIVED_TOPICS, DerivedBatches
from rtstack.log.analysis.signals import CURVES
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.samples import SIDES, Level, Mode
from rtstack.topics import ARM_TOPICS, CONTROL_TOPICS, EVENT_TOPIC, PLOTTED_TOPICS

_NS = 1e-9
_MODES, _LEVELS = ({int(member): member.name for member in kind} for kind in (Mode, Level))


class _Modes:
    """Follows one arm's mode and keeps where it changed."""

    def __init__(self, start_ns: int) -> None:
        self._start_ns = start_ns
        self.spans: list[tuple[float, float, str]] = []

    def add(self, records: NDArray) -> None:
        """Continue with the next records of /side/control."""
        if not len(records):
            return
        t_s = (records["t_ns"] - self._start_ns) * _NS
        changes = np.flatnonzero(np.diff(records["mode"])) + 1
        starts = [0, *changes.tolist()]
        for start, end in zip(starts, [*changes.tolist(), len(records) - 1], strict=True):
            mode = _MODES.get(int(records["mode"][start]), "UNKNOWN")
            if self.spans and self.spans[-1][2] == mode:
                self.spans[-1] = (self.spans[-1][0], float(t_s[end]), mode)
            else:
                if self.spans:
                    self.spans[-1] = (self.spans[-1][0], float(t_s[start]), self.spans[-1][2])
                self.spans.append((float(t_s[start]), float(t_s[end]), mode))


def _marks(records: Iterable[Any], start_ns: int) -> list[Mark]:
    return [
        Mark(
            t_s=(int(record["t_ns"]) - start_ns) * _NS,
            level=_LEVELS.get(int(record["level"]), "INFO"),
            name=bytes(record["name"]).decode("utf-8", "replace"),
            text=bytes(record["text"]).decode("utf-8", "replace"),
        )
        for record in records
    ]


def convert(log: Log, folder: Path, begun: Callable[[], None] = lambda: None) -> Index:
    """Write the columns of a log into an existing folder, and its index after each batch. Raises LogError, OSError.

    begun: called once, when the first part can be seen.
    """
    sides = log.sides
    no_arm = tuple(f"/{side}/" for side in SIDES if side not in sides)
    topics = [topic for topic in CURVES if not topic.startswith(no_arm)]
    index = Index(log.start_ns, log.duration_s, dict.fromkeys(topics, 0))
    index.write(folder)
    counts = {topic: log.count(topic) for topic in PLOTTED_TOPICS}
    counts |= {topic: log.count(arm) for topic, arm in zip(DERIVED_TOPICS, ARM_TOPICS, strict=True)}
    writers = {topic: ColumnWriter(folder, topic, count) for topic, count in counts.items() if count}
    deriving = DerivedBatches(log)
    modes = {side: _Modes(log.start_ns) for side in sides}
    events = list(index.events)

    def append(found: Iterable[tuple[str, NDArray]]) -> None:
        for topic, records in found:
            if topic in writers:
                writers[topic].append(records)

    try:
        parent = os.getppid()
        for number, batch in enumerate(log.batches([*PLOTTED_TOPICS, EVENT_TOPIC])):
            if os.getppid() != parent:
                raise SystemExit(1)  # the parent has gone, and starts again
            events += _marks(batch.records.get(EVENT_TOPIC, ()), log.start_ns)
            append((*batch.records.items(), *deriving.add(batch.records)))
            for side in sides:
                modes[side].add(batch.records.get(CONTROL_TOPICS[SIDES.index(side)], np.zeros(0)))
            marks, spans = sorted(events, key=lambda mark: mark.t_s), {side: modes[side].spans for side in sides}
            index = replace(index, rows=_rows(topics, writers), share=batch.share, events=marks, modes=spans)
            index.write(folder)
            if number == 0:
                begun()
        append(deriving.rest())
    finally:
        for writer in writers.values():
            writer.close()
    index = replace(index, rows=_rows(topics, writers), share=1.0, done=True)
    index.write(folder)
    return index


def _rows(topics: Sequence[str], writers: dict[str, ColumnWriter]) -> dict[str, int]:
    return {topic: writers[topic].rows if topic in writers else 0 for topic in topics}


def main(log: str, folder: str) -> int:
    """Convert one log. Returns 2, with one line on standard error and in the index, where it cannot be read."""
    try:
        convert(read_log(Path(log), truncated=True), Path(folder), stand_back)  # a page waits for the first part
    except (LogError, OSError, MemoryError) as error:
        if isinstance(error, MemoryError):
            error = LogError(f"it takes more than {MEMORY_GB} GB of memory")
        Index(0, 0.0, {}, done=True, error=str(error)).write(Path(folder))
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
