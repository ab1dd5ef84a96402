"""The columns of a log on disk: what the review reads instead of the MCAP file. A cache: the file is the truth.

A folder a log. `index.json` says how far it is; for each topic there are `t_ns` (n,), `values` (signals, n), and the
smallest and largest values of every BUCKET samples, `low` and `high` (signals, n / BUCKET), as .npy files: every
column is contiguous, so that a curve is one piece of the file and a whole log at a glance is a 64th of it.
"""

import os
from dataclasses import dataclass, field
from functools import lru_cache
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
import numpy as np
from numpy.typing import NDArray

from console.refused import Refused
from hal.base.files import write_whole
from rtstack.log.analysis.offered import Analysed
from rtstack.log.analysis.signals import Signal, column_block, signals, topic_signals
from rtstack.samples import SIDES
from rtstack.topics import ARM_TOPICS

BUCKET = 64
INDEX = "index.json"
VERSION = 2


@dataclass(frozen=True, slots=True)
class Mark:
    """An event: s since the start of the log, severity, who speaks, what."""

    t_s: float
    level: str
    name: str
    text: str


@dataclass(frozen=True, slots=True)
class Index:
    """What is known of a log so far. rows: samples of each topic that can be read; share: of the file, 0 to 1.

    modes: (from, to, mode) of each arm by its side, s since the start; error: why reading ended early. Nothing is in it
    of an arm that the log does not have. analyses: what those of installed packages say; sources: the files that they
    were loaded from.
    """

    start_ns: int
    duration_s: float
    rows: dict[str, int]
    share: float = 0.0
    done: bool = False
    error: str | None = None
    events: list[Mark] = field(default_factory=list)
    modes: dict[str, list[tuple[float, float, str]]] = field(default_factory=dict)
    analyses: list[Analysed] = field(default_factory=list)
    sources: list[str] = field(default_factory=list)
    version: int = VERSION

    @property
    def signals(self) -> dict[str, Signal]:
        """All signals by name, those of the analyses, too."""
        return signals() | {signal.name: signal for one in self.analyses for signal in one.signals}

    @property
    def sides(self) -> tuple[str, ...]:
        """The sides of the arms that the log has."""
        return tuple(side for side, arm in zip(SIDES, ARM_TOPICS, strict=True) if arm in self.rows)

    def write(self, folder: Path) -> None:
        """Replace the folder's index in one step: a reader sees the old one or the new one."""
        write_whole(folder / INDEX, msgspec.json.encode(self), durable=False)


def read_index(folder: Path) -> Index | None:
    """Return the index of a folder, None where there is none, or one of another version."""
    try:
        index = msgspec.json.decode((folder / INDEX).read_bytes(), type=Index)
    except (OSError, msgspec.MsgspecError):
        return None
    return index if index.version == VERSION else None


def _file(folder: Path, topic: str, what: str) -> Path:
    return folder / f"{topic.strip('/').replace('/', '.')}.{what}.npy"


class ColumnWriter:
    """Writes the columns of one topic, batch by batch, into files made for `capacity` samples."""

    def __init__(self, folder: Path, topic: str, capacity: int, count: int = 0) -> None:
        """count: of the topic's signals, 0 for a topic of the table."""
        self._topic, self._capacity, self._buckets = topic, capacity, -(-capacity // BUCKET)
        count = count or len(topic_signals(topic))
        self._time = _created(_file(folder, topic, "t_ns"), np.dtype(np.int64), (capacity,))
        self._values, self._low, self._high = (
            _created(_file(folder, topic, name), np.dtype(np.float32), (count, width))
            for name, width in (("values", capacity), ("low", self._buckets), ("high", self._buckets))
        )
        self._newest_ns = np.iinfo(np.int64).min
        self._open = np.zeros((count, 0), np.float32)  # samples of the bucket that is not full yet
        self.rows = 0

    def append(self, records: NDArray) -> None:
        """Write records, (n,)."""
        records = records[: self._capacity - self.rows]
        self.put(records["t_ns"], column_block(self._topic, records))

    def put(self, t_ns: NDArray[np.int64], block: NDArray[np.float32]) -> None:
        """Write the values of all signals, (signals, n), at their times, (n,). Times that go back are held."""
        t_ns = np.maximum(np.maximum.accumulate(t_ns), self._newest_ns)
        if not len(t_ns):
            return
        self._newest_ns = int(t_ns[-1])
        _put(self._time, t_ns[None], self.rows, self._capacity)
        _put(self._values, block, self.rows, self._capacity)
        first = self.rows // BUCKET
        waiting = np.concatenate([self._open, block], axis=1)
        starts = np.arange(0, waiting.shape[1], BUCKET)
        # fmin and fmax pass over NaN: one missing sample must not hide 63 others
        _put(self._low, np.fmin.reduceat(waiting, starts, axis=1), first, self._buckets)
        _put(self._high, np.fmax.reduceat(waiting, starts, axis=1), first, self._buckets)
        self.rows += len(t_ns)
        self._open = waiting[:, len(waiting[0]) - self.rows % BUCKET :]

    def close(self) -> None:
        """Close the files."""
        for file, _ in (self._time, self._values, self._low, self._high):
            file.close()


def _created(path: Path, dtype: np.dtype, shape: tuple[int, ...]) -> tuple[BinaryIO, int]:
    """Make an .npy file of this shape, empty; return it and where its data begins."""
    # sparse: no block is taken before it is written
    made = np.lib.format.open_memmap(path, mode="w+", dtype=dtype, shape=shape, version=(2, 0))
    return open(path, "r+b"), made.offset


def _put(target: tuple[BinaryIO, int], block: NDArray, column: int, width: int) -> None:
    """Write a block, (rows, n), at `column` of an array that is `width` wide."""
    file, data = target
    for row, values in enumerate(np.ascontiguousarray(block)):
        os.pwrite(file.fileno(), values.data, data + values.itemsize * (row * width + column))


@lru_cache(maxsize=256)  # a file of one size keeps its shape; parsing it takes longer than reading a curve
def _header(path: Path, _size: int) -> tuple[tuple[int, ...], np.dtype, int]:
    with open(path, "rb") as file:
        np.lib.format.read_magic(file)
        shape, _, dtype = np.lib.format.read_array_header_2_0(file)
        return shape, dtype, file.tell()


def _mapped(path: Path) -> NDArray[Any]:
    """Return an .npy file's array, as numpy.load maps it, in a tenth of the time. Raises FileNotFoundError."""
    shape, dtype, data = _header(path, path.stat().st_size)
    with open(path, "rb") as file:
        return np.ndarray(shape, dtype, mmap(file.fileno(), 0, access=ACCESS_READ), data)


@dataclass(frozen=True, slots=True)
class LogColumns:
    """Where a log's columns are, and how far they are."""

    folder: Path
    index: Index

    def of(self, topic: str) -> "Columns | None":
        """Return the columns of a topic, None while there are none. Raises Refused."""
        rows = self.index.rows.get(topic, 0)
        return Columns(self.folder, topic, rows) if rows else None


class Columns:
    """The columns of one topic, read-only, mapped into memory. t_ns (rows,), values (signals, rows), by a signal's
    column; low and high (signals, buckets): the smallest and the largest of every BUCKET samples there are so far.
    """

    def __init__(self, folder: Path, topic: str, rows: int) -> None:
        """Raises Refused."""
        buckets = -(-rows // BUCKET)
        try:
            t_ns, values, low, high = (
                _mapped(_file(folder, topic, name)) for name in ("t_ns", "values", "low", "high")
            )
        except FileNotFoundError as error:
            raise Refused(409, "what was read of this log had to make room: ask again") from error
        self.t_ns: NDArray[np.int64] = t_ns[:rows]
        self.values, self.low, self.high = values[:, :rows], low[:, :buckets], high[:, :buckets]
