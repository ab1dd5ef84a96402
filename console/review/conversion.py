"""A process of its own that reads a log once and writes its columns: python -m console.review.conversion LOG FOLDER

The index in the folder grows with every batch, so that a page shows the beginning while the rest is being read.
"""

import os
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from console.child_process import MEMORY_GB, stand_back, within
from console.review.columns import ColumnWriter, Index, Mark
from hal.extensions import package_of
from rtstack.log.analysis.derived import DERIVED_TOPICS, DerivedBatches
from rtstack.log.analysis.offered import Analysed, analyse, installed
from rtstack.log.analysis.signals import CURVES
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.samples import SIDES, Level, Mode
from rtstack.topics import ARM_TOPICS, CONTROL_TOPICS, EVENT_TOPIC, PLOTTED_TOPICS

_NS = 1e-9
_ANALYSIS_S = 60.0  # for one analysis of one log: it is then given up
_MODES, _LEVELS = ({int(member): member.name for member in kind} for kind in (Mode, Level))


def _follow(spans: list[tuple[float, float, str]], records: NDArray, start_ns: int) -> None:
    """Continue an arm's modes, (from s, to s, mode), with the next records of /side/control."""
    edges = [0, *(np.flatnonzero(np.diff(records["mode"])) + 1).tolist()][: len(records)]
    for start, end in pairwise([*edges, len(records) - 1]):
        from_s, to_s = ((int(records["t_ns"][row]) - start_ns) * _NS for row in (start, end))
        mode = _MODES.get(int(records["mode"][start]), "UNKNOWN")
        if spans:
            since_s, _, last = spans[-1]
            spans[-1] = since_s, to_s if mode == last else from_s, last
        if not spans or spans[-1][2] != mode:
            spans.append((from_s, to_s, mode))


def _mark(record: Any, start_ns: int) -> Mark:
    name, text = (bytes(record[key]).decode("utf-8", "replace") for key in ("name", "text"))
    return Mark((int(record["t_ns"]) - start_ns) * _NS, _LEVELS.get(int(record["level"]), "INFO"), name, text)


def convert(log: Log, folder: Path, begun: Callable[[], None] = lambda: None) -> Index:
    """Write a log's columns and index into a folder; call `begun` once a part is there. Raises LogError, OSError."""
    sides = log.sides
    no_arm = tuple(f"/{side}/" for side in SIDES if side not in sides)
    topics = [topic for topic in CURVES if not topic.startswith(no_arm)]
    index = Index(log.start_ns, log.duration_s, dict.fromkeys(topics, 0))
    index.write(folder)
    counts = {topic: log.count(topic) for topic in PLOTTED_TOPICS}
    counts |= {topic: log.count(arm) for topic, arm in zip(DERIVED_TOPICS, ARM_TOPICS, strict=True)}
    writers = {topic: ColumnWriter(folder, topic, count) for topic, count in counts.items() if count}
    deriving = DerivedBatches(log)
    modes: dict[str, list[tuple[float, float, str]]] = {side: [] for side in sides}
    events: list[Mark] = []

    def append(found: Iterable[tuple[str, NDArray]]) -> None:
        for topic, records in found:
            if topic in writers:
                writers[topic].append(records)

    try:
        parent = os.getppid()
        for number, batch in enumerate(log.batches([*PLOTTED_TOPICS, EVENT_TOPIC])):
            if os.getppid() != parent:
                raise SystemExit(1)  # the parent has gone, and starts again
            events += [_mark(record, log.start_ns) for record in batch.records.get(EVENT_TOPIC, ())]
            append((*batch.records.items(), *deriving.add(batch.records)))
            for side, topic in zip(SIDES, CONTROL_TOPICS, strict=True):
                if side in modes and topic in batch.records:
                    _follow(modes[side], batch.records[topic], log.start_ns)
            marks = sorted(events, key=lambda mark: mark.t_s)
            index = replace(index, rows=_rows(topics, writers), share=batch.share, events=marks, modes=modes)
            index.write(folder)
            if number == 0:
                begun()
        append(deriving.rest())
    finally:
        for writer in writers.values():
            writer.close()
    index = replace(index, rows=_rows(topics, writers), share=1.0)
    for name, package in installed():
        died = Analysed(name, package, error=f"analysis {name!r} of {package}: it has ended the process that it ran in")
        replace(index, analyses=[*index.analyses, died]).write(folder)  # what stands there if it does
        index = _with_analysis(index, log, name, folder)
    files = (getattr(module, "__file__", None) for name, module in list(sys.modules.items()) if package_of(name))
    index = replace(index, sources=[*filter(None, files)], done=True)
    index.write(folder)
    return index


def _with_analysis(index: Index, log: Log, name: str, folder: Path) -> Index:
    """Return an index with what one analysis says of the log; write its curves."""
    with within(_ANALYSIS_S):
        found, curves = analyse(log, name)
    rows = dict(index.rows)
    for signal, curve in zip(found.signals, curves, strict=True):
        rows[signal.topic] = len(curve.t_ns)
        if len(curve.t_ns):
            with closing(ColumnWriter(folder, signal.topic, len(curve.t_ns), count=1)) as writer:
                writer.put(curve.t_ns.astype(np.int64), curve.values[None].astype(np.float32))
    return replace(index, rows=rows, analyses=[*index.analyses, found])


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
