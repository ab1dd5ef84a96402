"""Shared-memory rings between the real-time loop and who watches it: one ring a topic, one block for all.

No side waits for the other: a reader that is too slow loses records and knows how many. The block also carries how far
the log process has read, its state, and the request to finish.
"""

import os
import secrets
import threading
from collections.abc import Mapping
from contextlib import AbstractContextManager
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.base.shared import Block
from rtstack.log.errors import LogError
from rtstack.log.time_of_day import TIMES
from rtstack.topics import TOPICS

CAPACITY = 8192  # records, 8 s at 1 kHz: what a start-up of the log process takes, several times over
_MAGIC = b"rtrings2"
_CACHE_LINE = 64


class LogState(IntEnum):
    STARTING = 0
    READY = 1
    FAILED = 2
    FINISHED = 3


# 512 bytes, whole cache lines
_CONTROL = np.dtype(
    [("magic", "S8"), ("closing", "i8"), ("state", "i8"), ("messages", "i8"), ("times", TIMES), ("error", "S408")]
)
# the writer's word and the log process's words on cache lines of their own
_TOPIC = np.dtype({
    "names": ["capacity", "itemsize", "head", "consumed", "lost"], "formats": ["i8"] * 5,
    "offsets": [0, 8, _CACHE_LINE, 2 * _CACHE_LINE, 2 * _CACHE_LINE + 8], "itemsize": 3 * _CACHE_LINE,
})  # fmt: skip
_ITEMSIZES = [topic.record.itemsize for topic in TOPICS.values()]
_SLOTS_OFFSET = _CONTROL.itemsize + len(TOPICS) * _TOPIC.itemsize


def _slot_dtype(topic: str) -> np.dtype:
    return np.dtype([("sequence", "i8"), ("record", TOPICS[topic].record)])


class Pusher:
    """The writer's side of one ring. One thread of one process pushes."""

    __slots__ = ("_dtype", "_keep", "_push", "_record", "_row")

    def __init__(self, head: NDArray[np.int64], slots: NDArray[Any]) -> None:
        from rtstack.log.push import push  # numba: only who pushes pays for its import

        self._push, self._keep = push, (head, slots)
        self._dtype = slots.dtype["record"]
        self._record: NDArray[Any] | None = None
        self._row = head.ctypes.data, slots.ctypes.data, slots.dtype.itemsize, len(slots) - 1, 0

    def push(self, record: NDArray[Any]) -> None:
        """Publish a copy of `record`, (1,), of the topic's dtype.

        Never waits or allocates. The first push of an array looks up its address and checks it (TypeError): push the
        same array always.
        """
        if record is not self._record:
            self.bind(record)
        self._push(*self._row)

    def bind(self, record: NDArray[Any]) -> tuple[int, int, int, int, int]:
        """Look up where `record` is; return a row for `rtstack.log.push.push_all`.

        The row holds addresses: keep the pusher and the record as long as it is used.
        """
        if record.dtype != self._dtype or record.shape != (1,):
            raise TypeError(f"a record of shape (1,) and dtype {self._dtype} is needed, not {record.dtype}")
        self._record, self._row = record, (*self._row[:4], record.ctypes.data)
        return self._row


class RingReader:
    """One reader's position in one ring. `lost` counts what was overwritten before it was read."""

    def __init__(self, topic: NDArray[Any], slots: NDArray[Any], next_record: int, publishes: bool) -> None:
        self._topic = topic
        self._head = topic["head"]
        self._slots = slots
        self._next = next_record
        self._publishes = publishes
        self._barrier = threading.Lock()  # used here only: its acquire and release order our loads
        self.lost = 0

    def drain(self) -> NDArray[Any]:
        """Return a copy of everything published since the last call, shape (n,), oldest first."""
        capacity = len(self._slots)
        with self._barrier:
            head = int(self._head[0])
        first = max(self._next, head - capacity)
        start, end = first % capacity, first % capacity + head - first
        parts = slice(start, end), slice(0, max(0, end - capacity))  # the first one ends with the ring
        records = np.concatenate([self._slots["record"][part] for part in parts])
        with self._barrier:
            sequence = np.concatenate([self._slots["sequence"][part] for part in parts])
        # the sequence moves on before the record does: the right sequence after the copy means an untorn copy
        whole = sequence == 2 * np.arange(first, head) + 2
        if not whole.all():
            records = records[whole]
        self.lost += head - self._next - len(records)
        self._next = head
        if self._publishes:
            self._topic["lost"] = self.lost
            self._topic["consumed"] = head
        return records

    def latest(self) -> NDArray[Any] | None:
        """Return a copy of the newest record, shape (1,), None before the first. Does not move the reader."""
        capacity = len(self._slots)
        while True:
            with self._barrier:
                head = int(self._head[0])
            if head == 0:
                return None
            slot = (head - 1) % capacity
            record = self._slots["record"][slot : slot + 1].copy()
            with self._barrier:
                if self._slots["sequence"][slot] == 2 * head:
                    return record


class Rings(AbstractContextManager["Rings", None]):
    """All rings of a trial. The process that creates them owns the block and unlinks it in `close`."""

    def __init__(self, block: Block) -> None:
        self.name, self._block = block.name, block
        self._control = np.frombuffer(block.memory, _CONTROL, 1)
        self._topics = np.frombuffer(block.memory, _TOPIC, len(TOPICS), _CONTROL.itemsize)
        self._heads, self._consumed = self._topics["head"], self._topics["consumed"]
        self._capacities = self._topics["capacity"]

    @classmethod
    def create(cls, capacity: int = CAPACITY, capacities: Mapping[str, int] | None = None) -> "Rings":
        """Create the block: `capacity` records a topic; `capacities` overrides single topics.

        Raises ValueError for a capacity that is no power of two, LogError where shared memory is exhausted.
        """
        sizes = {topic: (capacities or {}).get(topic, capacity) for topic in TOPICS}
        for topic, records in sizes.items():
            if records < 2 or records & (records - 1):
                raise ValueError(f"{topic}: the capacity of a ring is a power of two, not {records}")
        size = _SLOTS_OFFSET + sum(_slot_dtype(topic).itemsize * records for topic, records in sizes.items())
        try:
            rings = cls(Block.create(f"rtstack-{os.getpid()}-{secrets.token_hex(4)}", size))
        except OSError as error:
            raise LogError(f"no shared memory for the log ({size / 1e6:.0f} MB): {error.strerror}") from error
        rings._topics["capacity"], rings._topics["itemsize"] = list(sizes.values()), _ITEMSIZES
        rings._control["magic"] = _MAGIC
        return rings

    @classmethod
    def attach(cls, name: str) -> "Rings":
        """Map another process's block. Raises LogError where there is none, or one of another version."""
        try:
            rings = cls(Block.attach(name))
        except (OSError, ValueError) as error:
            raise LogError(f"there are no rings named {name}") from error
        if rings._control["magic"][0] != _MAGIC or rings._topics["itemsize"].tolist() != _ITEMSIZES:
            raise LogError(f"the rings {name} belong to another version of the program")
        return rings

    def _ring(self, topic: str) -> tuple[NDArray[Any], NDArray[Any]]:
        offset = _SLOTS_OFFSET
        for index, name in enumerate(TOPICS):
            capacity = int(self._topics[index]["capacity"])
            if name == topic:
                slots = np.frombuffer(self._block.memory, _slot_dtype(topic), capacity, offset)
                return self._topics[index : index + 1], slots
            offset += _slot_dtype(name).itemsize * capacity
        raise KeyError(topic)

    def pusher(self, topic: str) -> Pusher:
        """Return the writer's side of a ring. Raises KeyError for a topic that is not in TOPICS."""
        line, slots = self._ring(topic)
        return Pusher(line["head"], slots)

    def reader(self, topic: str, oldest: bool = False) -> RingReader:
        """Return a reader that starts with the next record, or the first. Raises KeyError for a topic not in TOPICS."""
        line, slots = self._ring(topic)
        return RingReader(line, slots, 0 if oldest else int(line["head"][0]), publishes=False)

    def log_reader(self, topic: str) -> RingReader:
        """Return the log process's reader: starts with the first record, publishes how far it has read."""
        return RingReader(*self._ring(topic), 0, publishes=True)

    def room(self) -> int:
        """Return how many records every ring takes before the log loses one: a run that is faster than real time waits
        for it, outside of the tick.

        Without a log process to wait for (it failed or finished) there is always room.
        """
        if self._control["state"][0] >= LogState.FAILED:
            return self.capacity
        return max(0, int((self._consumed - self._heads + self._capacities).min()))

    @property
    def capacity(self) -> int:
        return int(self._capacities.min())

    def lost(self, topic: str) -> int:
        return int(self._topics["lost"][list(TOPICS).index(topic)])

    @property
    def state(self) -> LogState:
        return LogState(int(self._control["state"][0]))

    @state.setter
    def state(self, state: LogState) -> None:
        self._control["state"] = state

    @property
    def error(self) -> str:
        """Why the log process failed, empty if it did not."""
        return bytes(self._control["error"][0]).decode("utf-8", "replace")

    def fail(self, reason: str) -> None:
        """Say why the log process failed, and that it did."""
        self._control["error"] = reason.encode()[: _CONTROL["error"].itemsize]
        self.state = LogState.FAILED

    @property
    def messages(self) -> int:
        """Number of messages that the log process has written, /tf included."""
        return int(self._control["messages"][0])

    @messages.setter
    def messages(self, count: int) -> None:
        self._control["messages"] = count

    @property
    def times(self) -> NDArray[np.void]:
        """The log's pairs of robot's time and time of day, TIMES (1,): a view."""
        return self._control["times"]

    @property
    def closing(self) -> bool:
        return bool(self._control["closing"][0])

    def request_close(self) -> None:
        """Tell the log process to read what is left and to finish the file."""
        self._control["closing"] = 1

    def close(self) -> None:
        """Unlink the block, if it is ours. Existing views stay valid. May be called twice."""
        self._block.close()

    def __exit__(self, *exception: object) -> None:
        self.close()
