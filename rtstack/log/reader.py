"""Reading a log for analysis: columns of records, metadata, attachments, events."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.records import Chunk, ChunkIndex
from numpy.typing import NDArray

from rtstack.log.errors import LogError
from rtstack.log.file import container
from rtstack.log.file.container import MessageTable
from rtstack.log.file.contents import Contents, contents_by_scan, contents_by_summary
from rtstack.log.file.decoding import TopicDecoder, message_class
from rtstack.log.video import KEY_NS, Decoder
from rtstack.log.viewers.scenery import scenery_schemas
from rtstack.log.writing.job import Attachment
from rtstack.samples import SIDES, Level
from rtstack.topics import ARM, ARM_TOPICS, EVENT_TOPIC, TOPICS

_NS = 1e-9


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened: who speaks (`name`), what (`text`), how severe."""

    t_ns: int
    level: Level
    name: str
    text: str


@dataclass(frozen=True, slots=True)
class Batch:
    """Records of some topics from neighbouring chunks; `share` of the file that has been read so far, 0 to 1."""

    records: dict[str, NDArray[Any]]
    share: float


class Log:
    """An open log. Topics are read when they are asked for, and not kept: hold on to what `topic` returns."""

    def __init__(self, path: Path, contents: Contents, complete: bool) -> None:
        self._contents = contents
        self.path = path
        self.complete = complete
        self.metadata: dict[str, dict[str, str]] = contents.metadata
        self.attachments: tuple[Attachment, ...] = tuple(contents.attachments)

    @property
    def duration_s(self) -> float:
        """Robot's time from the first to the last message, s."""
        return (self._contents.end_ns - self._contents.start_ns) * _NS

    @property
    def start_ns(self) -> int:
        """Robot's time of the first message, ns."""
        return self._contents.start_ns

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics with messages."""
        return tuple(sorted({channel.topic for channel in self._contents.channels.values()}))

    @property
    def sides(self) -> tuple[str, ...]:
        """The sides of the arms that it has samples of, left before right; both where it has none at all."""
        return tuple(side for side, topic in zip(SIDES, ARM_TOPICS, strict=True) if self.count(topic)) or SIDES

    @property
    def events(self) -> tuple[Event, ...]:
        """All events, in order of time."""
        records = self.topic(EVENT_TOPIC)
        return tuple(
            Event(
                int(record["t_ns"]), Level(int(record["level"])) if record["level"] else Level.INFO,
                bytes(record["name"]).decode(), bytes(record["text"]).decode(),
            )
            for record in records[np.argsort(records["t_ns"], kind="stable")]
        )  # fmt: skip

    def attachment(self, name: str) -> bytes | None:
        """Return the content of the file that is attached under a name, None where there is none."""
        return next((each.data for each in self.attachments if each.name == name), None)

    def topic(self, name: str) -> NDArray[Any]:
        """Return all records of a topic of rtstack.topics.TOPICS, shape (n,), in the order of the file.

        t_ns is the message's log time, O_T_EE row-major, current_errors the bit mask. Raises LogError for
        another topic, or for messages that are not of its schema.
        """
        if name not in TOPICS:
            raise LogError(f"{name} is not a topic of records: there are {', '.join(TOPICS)}")
        parts, wanted = [np.zeros(0, TOPICS[name].record)], dict.fromkeys(self._channels(name), name)
        decoders: dict[int, TopicDecoder] = {}
        for part in self._tables(name):
            parts += self._decode([part], wanted, decoders).values()
        return np.concatenate(parts)

    def first_ns(self, name: str) -> int | None:
        """Return the log time of a topic's first message, None where it has none. Reads one chunk."""
        return next((int(table.log_time_ns.min()) for _, table in self._tables(name)), None)

    def between(self, topics: Sequence[str], from_ns: int, to_ns: int) -> dict[str, NDArray[Any]]:
        """Return the records of some topics from one log time to another, both included, in the order of the file.

        Chunks that the index places elsewhere are not read. Raises LogError as `topic` does.
        """
        wanted = {channel: topic for topic in topics for channel in self._channels(topic)}
        parts = list(self._read(list(wanted), (from_ns, to_ns)))
        found = self._decode(parts, wanted, {}) if parts else {}
        empty = {topic: np.zeros(0, TOPICS[topic].record) for topic in topics}
        inside = {name: part[(part["t_ns"] >= from_ns) & (part["t_ns"] <= to_ns)] for name, part in found.items()}
        return empty | inside

    def count(self, name: str) -> int:
        """Return how many messages a topic has."""
        return sum(self._contents.counts.get(channel, 0) for channel in self._channels(name))

    def batches(self, topics: Sequence[str], chunks: int = 16) -> Iterator[Batch]:
        """Read the file once, and yield the records of `topics` chunk by chunk: for a log that is too long for memory.

        Each batch has as many chunks; a topic without messages in them is left out. Raises LogError as `topic` does.
        """
        decoders: dict[int, TopicDecoder] = {}
        wanted = {channel: topic for topic in topics for channel in self._channels(topic)}
        total = max(1, len(self._contents.chunks))
        parts: list[tuple[bytes, MessageTable]] = []
        for done, part in enumerate(self._read(list(wanted)), start=1):
            parts.append(part)
            if len(parts) == chunks or done == total:
                yield Batch(self._decode(parts, wanted, decoders), done / total)
                parts.clear()

    def _decode(
        self, parts: list[tuple[bytes, MessageTable]], wanted: dict[int, str], decoders: dict[int, TopicDecoder]
    ) -> dict[str, NDArray[Any]]:
        """Decode several chunks as if they were one: the fewer calls, the less of the time is numpy's own."""
        starts = np.cumsum([0, *(len(data) for data, _ in parts)])
        data = b"".join(data for data, _ in parts)
        channel = np.concatenate([table.channel_id for _, table in parts])
        t_ns = np.concatenate([table.log_time_ns for _, table in parts])
        start = np.concatenate([table.start + offset for (_, table), offset in zip(parts, starts, strict=False)])
        size = np.concatenate([table.size for _, table in parts])
        found: dict[str, list[NDArray[Any]]] = {}
        for channel_id in np.unique(channel).tolist():
            if channel_id not in decoders:
                schema = self._contents.schemas[self._contents.channels[channel_id].schema_id]
                decoders[channel_id] = TopicDecoder(wanted[channel_id], schema)
            rows = channel == channel_id
            records = decoders[channel_id].decode(data, t_ns[rows], start[rows], size[rows])
            found.setdefault(wanted[channel_id], []).append(records)
        return {topic: np.concatenate(records) for topic, records in found.items()}

    def messages(self, name: str, between_ns: tuple[int, int] | None = None) -> list[tuple[int, bytes]]:
        """Return messages of any topic as (t_ns, encoded message): for /tf and pictures, which have no record.

        between_ns: of these log times alone, both included; chunks that the index places elsewhere are not read.
        """
        return [
            (t_ns, data[start : start + size])
            for data, table in self._read(self._channels(name), between_ns)
            for t_ns, start, size in zip(
                table.log_time_ns.tolist(), table.start.tolist(), table.size.tolist(), strict=True
            )
            if between_ns is None or between_ns[0] <= t_ns <= between_ns[1]
        ]

    def pictures(self, topic: str, between_ns: tuple[int, int] | None = None) -> list[tuple[int, bytes]]:
        """Return a camera's pictures as (t_ns, JPEG), like `messages`, in order. Raises LogError for H.264 without
        PyAV."""
        schemas = [self._contents.schemas[self._contents.channels[each].schema_id] for each in self._channels(topic)]
        if not schemas:
            return []
        video = schemas[0].name == "foxglove.CompressedVideo"
        first_ns, last_ns = between_ns or (0, 1 << 62)
        kind = message_class(schemas[0])
        span_ns = (first_ns - KEY_NS, last_ns) if video else (first_ns, last_ns)
        found = sorted((t_ns, kind.FromString(data).data) for t_ns, data in self.messages(topic, span_ns))
        if not video:
            return found
        decoder = Decoder()
        return [(t_ns, decoder.jpeg()) for t_ns, data in found if decoder.take(data) and t_ns >= first_ns]

    def times(self, topic: str) -> list[int]:
        """Return the log times of a topic's messages, ns, in order; from the index alone where there is one."""
        wanted, found = self._channels(topic), []
        with container.open_mcap(self.path) as file:
            for chunk in self._contents.chunks:
                if isinstance(chunk, ChunkIndex):
                    offsets = [at for each, at in chunk.message_index_offsets.items() if each in wanted]
                    found += [_index_entries(file, offset)[1][:, 0] for offset in offsets]
                    continue
                table = container.message_table(
                    chunk if isinstance(chunk, bytes) else _read_chunk(self.path, file, chunk)
                )
                found.append(table.log_time_ns[np.isin(table.channel_id, wanted)])
        return np.sort(np.concatenate([np.zeros(0, np.int64), *found])).tolist()

    def _channels(self, topic: str) -> list[int]:
        return [channel.id for channel in self._contents.channels.values() if channel.topic == topic]

    def _tables(self, topic: str) -> Iterator[tuple[bytes, MessageTable]]:
        """Yield each chunk that has messages of a topic, with their places in it."""
        return (part for part in self._read(self._channels(topic)) if len(part[1].start))

    def _read(self, wanted: list[int], span_ns: tuple[int, int] | None = None) -> Iterator[tuple[bytes, MessageTable]]:
        """Yield every chunk, with the places of the messages of some channels; without any it is not unpacked.

        span_ns: chunks that are indexed, and not in it, are left out.
        """
        with container.open_mcap(self.path) as file:
            for chunk in self._contents.chunks:
                if isinstance(chunk, ChunkIndex):
                    if span_ns and (chunk.message_end_time < span_ns[0] or chunk.message_start_time > span_ns[1]):
                        continue
                    indexed = chunk.message_index_offsets
                    offsets = [indexed[channel_id] for channel_id in wanted if channel_id in indexed]
                    data = _read_chunk(self.path, file, chunk.chunk_start_offset) if offsets else b""
                    yield data, _indexed(file, data, offsets)
                    continue
                data = chunk if isinstance(chunk, bytes) else _read_chunk(self.path, file, chunk)
                table = container.message_table(data)
                yield data, table.rows(np.isin(table.channel_id, wanted))


def read_log(path: Path, truncated: bool = False) -> Log:
    """Open a log. `truncated`: read a file without a summary as far as it goes.

    Raises LogError, with one clear line: no MCAP file, cut off, or not a log of ours.
    """
    path = Path(path)
    with container.open_mcap(path) as file:
        complete = container.is_complete(file)
        if not complete and not truncated:
            raise LogError(f"{path} is cut off (no summary): recover it with `rtstack recover {path}`")
        try:
            contents = contents_by_summary(file) if complete else contents_by_scan(file)
        except LogError:
            raise
        except Exception as error:  # the library raises whatever half a record makes of it
            raise LogError(f"{path} is damaged: {error or type(error).__name__}") from error
    topics = {channel.topic for channel in contents.channels.values()}
    arms = (contents.schemas.get(each.schema_id) for each in contents.channels.values() if each.topic in ARM_TOPICS)
    ours = any(schema is not None and schema.name == ARM.schema for schema in arms)
    # or of a run that ended before its first tick
    if ours or ({"log", "trial"} & contents.metadata.keys() and topics <= {*TOPICS, *scenery_schemas()}):
        return Log(path, contents, complete)
    raise LogError(f"{path} is an MCAP file but not a log of ours: topic {' or '.join(ARM_TOPICS)} is missing")


def _read_chunk(path: Path, file: BinaryIO, offset: int) -> bytes:
    file.seek(offset)
    try:
        header = file.read(container.RECORD_HEADER)
        body = file.read(int.from_bytes(header[1:], "little"))
        return container.chunk_data(Chunk.read(ReadDataStream(BytesIO(body))))
    except Exception as error:  # each decompressor has its own
        raise LogError(f"{path} is damaged at byte {offset}: {error or type(error).__name__}") from error


def _index_entries(file: BinaryIO, offset: int) -> tuple[int, NDArray[np.int64]]:
    """Return the channel of an index record, and (n, 2): log time, place in the chunk."""
    file.seek(offset + container.RECORD_HEADER)
    channel_id = int.from_bytes(file.read(2), "little")
    entries = file.read(int.from_bytes(file.read(4), "little"))
    if len(entries) % 16:
        raise LogError(f"{file.name} is damaged at byte {offset}: an index is cut off")
    return channel_id, np.frombuffer(entries, "<i8").reshape(-1, 2)


def _indexed(file: BinaryIO, data: bytes, offsets: list[int]) -> MessageTable:
    """The messages that the index records at these file offsets name."""
    bytes_of = np.frombuffer(data, np.uint8)
    columns = [np.zeros((4, 0), np.int64)]
    for offset in offsets:
        channel_id, entries = _index_entries(file, offset)
        position = entries[:, 1]
        if ((position < 0) | (position > len(data) - container.MESSAGE_HEADER)).any():
            raise LogError(
                f"{file.name} is damaged at byte {offset}: an index names messages that its chunk does not have"
            )
        # a message record is opcode, length (8 bytes), 22 bytes of numbers and times, and the message
        lengths = bytes_of[position[:, None] + np.arange(1, container.RECORD_HEADER)].copy().view("<i8")[:, 0]
        size = lengths - (container.MESSAGE_HEADER - container.RECORD_HEADER)
        if ((size < 0) | (size > len(data) - container.MESSAGE_HEADER - position)).any():
            raise LogError(f"{file.name} is damaged at byte {offset}: an index names no messages of its chunk")
        channel = np.full(len(entries), channel_id)
        columns.append(np.stack([channel, entries[:, 0], position + container.MESSAGE_HEADER, size]))
    table = np.concatenate(columns, axis=1)
    return MessageTable(table[0], table[1], table[2], table[3])
