"""Reading a log for analysis: columns of records, metadata, attachments, events."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError
from mcap.records import Schema
from numpy.typing import NDArray

from rtstack.log.errors import LogError, damaged, remedy
from rtstack.log.file.container import MAGIC, MESSAGES, NUMBERS, end_of, growth_max, open_mcap
from rtstack.log.file.contents import ALWAYS, Contents, attachment_data, read_contents
from rtstack.log.file.decoding import TopicDecoder, message_class
from rtstack.log.file.salvage import Salvage
from rtstack.log.video import KEY_NS, Decoder
from rtstack.log.viewers.scenery import scenery_schemas
from rtstack.log.writing.job import Attachment
from rtstack.samples import SIDES, Level
from rtstack.topics import ARM, ARM_TOPICS, EVENT_TOPIC, TOPICS, unit_of

_NS = 1e-9
_AT_ONCE = 16  # chunks that are decoded as one
_SMALL_CHUNK = 1 << 16  # bytes; larger ones are not copied together
_CHANNELS_MAX = 64  # of one topic: each has a decoder
_MESSAGE_BYTES = 160  # what Python needs for one message, beside its own bytes


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
        self._span_ns = self._edge(last=False), self._edge(last=True)

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """The attached files, read now. Raises LogError for one that is damaged."""
        with open_mcap(self.path) as file:
            places = self._contents.attachments
            return tuple(Attachment(each.name, each.media_type, attachment_data(file, each)) for each in places)

    @property
    def duration_s(self) -> float:
        """Robot's time from the first to the last message, s. Topics of other programs do not count."""
        return (self._span_ns[1] - self._span_ns[0]) * _NS

    @property
    def start_ns(self) -> int:
        """Robot's time of the first message, ns."""
        return self._span_ns[0]

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
        return tuple(
            Event(
                int(record["t_ns"]), Level(int(record["level"])) if record["level"] else Level.INFO,
                bytes(record["name"]).decode(), bytes(record["text"]).decode(),
            )
            for record in self.topic(EVENT_TOPIC)
        )  # fmt: skip

    def attachment(self, name: str) -> bytes | None:
        """Return the content of the file that is attached under a name, None where there is none."""
        place = next((each for each in self._contents.attachments if each.name == name), None)
        with open_mcap(self.path) as file:
            return None if place is None else attachment_data(file, place)

    def topic(self, name: str) -> NDArray[Any]:
        """Return all records of a topic of rtstack.topics.TOPICS, shape (n,), in the order of their log times.

        t_ns is the message's log time, O_T_EE row-major, current_errors the bit mask. Raises LogError for
        another topic, or for messages that are not of its schema.
        """
        found = [self._empty([name])[name]]
        small = self.path.stat().st_size < _SMALL_CHUNK * len(self._contents.parts)
        for batch in self._batches([name], _AT_ONCE if small else 1):
            found += batch.records.values()
        return _in_order(None, np.concatenate(found))

    def frame(self, topic: str) -> Any:
        """Return all records of a topic as a pandas.DataFrame, in order of time.

        The index `t_s` is the time since `start_ns`, s; the first column `t_ns` the robot's time. The columns of an
        array are those of the curves, as tau_J.4 or O_F_ext_hat_K.fz, of a 4 x 4 matrix r11 to r33 and x, y, z;
        `frame.attrs["units"]` has the unit of each column. Raises LogError as `topic` does, and without pandas.
        """
        try:
            import pandas  # pyright: ignore[reportMissingImports]  # optional
        except ImportError:
            raise LogError("tables are made by pandas: pip install pandas; `topic` has the same records") from None

        records = self.topic(topic)
        columns: dict[str, NDArray[Any]] = {"t_ns": records["t_ns"]}
        units = {"t_s": "s", "t_ns": "ns"}
        for field in TOPICS[topic].message.fields:
            values = records[field.name]
            values = values.reshape(len(values), math.prod(values.shape[1:]))
            values = np.char.decode(values, errors="replace") if values.dtype.kind == "S" else values
            for k, component in enumerate(field.axes or ("",)):
                name = f"{field.name}.{component}" if component else field.name
                columns[name], units[name] = values[:, k], unit_of(field, component)
        frame = pandas.DataFrame(columns, pandas.Index((records["t_ns"] - self.start_ns) * _NS, name="t_s"))
        frame.attrs["units"] = units
        return frame

    def first_ns(self, name: str) -> int | None:
        """Return the log time of a topic's first message, None where it has none. Reads one chunk, as a rule."""
        return self._edge(last=False, topics=[name]) if self.count(name) else None

    def between(self, topics: Sequence[str], from_ns: int, to_ns: int) -> dict[str, NDArray[Any]]:
        """Return the records of some topics from one log time to another, both included, in order of time.

        Chunks that the index places elsewhere are not read. Raises LogError as `topic` does.
        """
        wanted, found = self._wanted(topics), self._empty(topics)
        if parts := list(self._read(list(wanted), (from_ns, to_ns))):
            found |= self._decode(parts, wanted, {})
        return {name: part[(part["t_ns"] >= from_ns) & (part["t_ns"] <= to_ns)] for name, part in found.items()}

    def count(self, name: str) -> int:
        """Return how many messages a topic has."""
        return sum(self._contents.counts.get(channel, 0) for channel in self._channels(name))

    def batches(self, topics: Sequence[str], chunks: int = _AT_ONCE) -> Iterator[Batch]:
        """Read the file once, and yield the records of `topics` chunk by chunk: for a log that is too long for memory.

        Each batch has as many chunks; a topic without messages in them is left out. A log whose chunks do not follow
        one another in time is one batch. Raises LogError as `topic` does.
        """
        self._empty(topics)
        total = len(self._contents.parts)
        yield from self._batches(topics, chunks if total <= chunks or self._in_turn(self._wanted(topics)) else total)

    def _batches(self, topics: Sequence[str], chunks: int) -> Iterator[Batch]:
        decoders: dict[int, TopicDecoder] = {}
        wanted = self._wanted(topics)
        total = len(self._contents.parts)
        parts: list[tuple[bytes, NDArray[Any]]] = []
        for done, part in enumerate(self._read(list(wanted)), start=1):
            parts.append(part)
            if len(parts) == chunks or done == total:
                yield Batch(self._decode(parts, wanted, decoders), done / total)
                parts.clear()

    def _in_turn(self, wanted: dict[int, str]) -> bool:
        """Whether the messages of each topic stand in the file in order of time."""
        spans = [part.span_ns for part in self._contents.parts]
        topics = list(wanted.values())
        if len(set(topics)) == len(topics) and all(a[1] <= b[0] for a, b in pairwise(spans)):
            return True
        newest: dict[str, int] = {}
        for _, table in self._read(list(wanted)):
            for channel in np.unique(table["channel"]).tolist():
                times = table["log_time_ns"][table["channel"] == channel]
                topic = wanted[channel]
                if int(times.min()) < newest.get(topic, 0):
                    return False
                newest[topic] = max(newest.get(topic, 0), int(times.max()))
        return True

    def _decode(
        self, parts: list[tuple[bytes, NDArray[Any]]], wanted: dict[int, str], decoders: dict[int, TopicDecoder]
    ) -> dict[str, NDArray[Any]]:
        """Decode several chunks as if they were one: the fewer calls, the less of the time is numpy's own."""
        starts = np.cumsum([0, *(len(data) for data, _ in parts)])
        data = b"".join(data for data, _ in parts)
        tables = np.concatenate([table for _, table in parts])
        tables["start"] += np.repeat(starts[:-1], [len(table) for _, table in parts])
        channel, t_ns, start, size = (tables[name] for name in MESSAGES.names or ())
        t_ns = t_ns.astype(np.int64)
        if len(t_ns) and t_ns.min() < 0:
            raise LogError(f"{self.path}: a sample has a time that no robot has: {t_ns.view(np.uint64).max()} ns")
        found: dict[str, list[tuple[NDArray[np.intp], NDArray[Any]]]] = {}
        for channel_id in np.unique(channel).tolist():
            if channel_id not in decoders:
                decoders[channel_id] = TopicDecoder(wanted[channel_id], self._schema(channel_id))
            rows = np.flatnonzero(channel == channel_id)
            records = decoders[channel_id].decode(data, t_ns[rows], start[rows], size[rows])
            found.setdefault(wanted[channel_id], []).append((rows, records))
        return {topic: _in_order(*map(np.concatenate, zip(*parts, strict=True))) for topic, parts in found.items()}

    def messages(self, name: str, between_ns: tuple[int, int] | None = None) -> list[tuple[int, bytes]]:
        """Return messages of any topic as (t_ns, encoded message): for /tf and pictures, which have no record.

        between_ns: of these log times alone, both included; chunks that the index places elsewhere are not read.
        """
        self._afford(name, _MESSAGE_BYTES)
        found = [
            (t_ns, data[start : start + size])
            for data, table in self._read(self._channels(name), between_ns)
            for _, t_ns, start, size in table.tolist()
            if between_ns is None or between_ns[0] <= t_ns <= between_ns[1]
        ]
        return sorted(found, key=lambda message: message[0])

    def pictures(self, topic: str, between_ns: tuple[int, int] | None = None) -> list[tuple[int, bytes]]:
        """Return a camera's pictures as (t_ns, JPEG), like `messages`. Raises LogError for H.264 without PyAV."""
        schemas = [self._schema(each) for each in self._channels(topic)]
        if not schemas:
            return []
        video = schemas[0].name == "foxglove.CompressedVideo"
        first_ns, last_ns = between_ns or (0, 1 << 62)
        kind = message_class(schemas[0])
        span_ns = (first_ns - KEY_NS, last_ns) if video else (first_ns, last_ns)
        try:
            found = [(t_ns, kind.FromString(data).data) for t_ns, data in self.messages(topic, span_ns)]
        except (DecodeError, AttributeError) as error:
            raise LogError(f"{self.path}: a picture of {topic} is broken: {error}") from error
        if not video:
            return found
        decoder = Decoder()
        return [(t_ns, decoder.jpeg()) for t_ns, data in found if decoder.take(data) and t_ns >= first_ns]

    def times(self, topic: str) -> list[int]:
        """Return the log times of a topic's messages, ns, in order."""
        found = [table["log_time_ns"] for _, table in self._read(self._channels(topic))]
        return np.sort(np.concatenate([np.zeros(0, np.uint64), *found])).tolist()

    def _channels(self, topic: str) -> list[int]:
        found = [channel.id for channel in self._contents.channels.values() if channel.topic == topic]
        if len(found) > _CHANNELS_MAX:
            raise LogError(f"{self.path}: {topic} has {len(found)} channels: at most {_CHANNELS_MAX} are read")
        return found

    def _wanted(self, topics: Sequence[str]) -> dict[int, str]:
        return {channel: topic for topic in topics for channel in self._channels(topic)}

    def _empty(self, topics: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Return no records of each topic. Raises LogError for what is no topic of records, or has far too many."""
        for name in topics:
            if name not in TOPICS:
                raise LogError(f"{name} is not a topic of records: there are {', '.join(TOPICS)}")
            self._afford(name, TOPICS[name].record.itemsize)
        return {name: np.zeros(0, TOPICS[name].record) for name in topics}

    def _afford(self, topic: str, each: int) -> None:
        """Raise LogError where a topic's messages, with so many bytes each, need far more memory than the file."""
        if (count := self.count(topic)) * each > growth_max(self.path.stat().st_size):
            raise LogError(f"{self.path} is not read: {count} messages of {topic} are too many for its size")

    def _schema(self, channel: int) -> Schema:
        found = self._contents.channels[channel]
        if found.schema_id not in self._contents.schemas:
            raise LogError(f"{self.path}: {found.topic} has no schema, so its messages cannot be read")
        return self._contents.schemas[found.schema_id]

    def _edge(self, last: bool, topics: Sequence[str] | None = None) -> int:
        """Return the first or last log time of some topics, by default of all that are ours; 0 without a message.

        Chunks are read from the edge on, until no other one can have an earlier (later) message.
        """
        contents = self._contents
        ours = topics or [*TOPICS, *scenery_schemas()]
        wanted = [each for each, channel in contents.channels.items() if channel.topic in ours]
        parts = [part for part in contents.parts if part.channels is None or not part.channels.isdisjoint(wanted)]
        parts.sort(key=lambda part: part.span_ns[last], reverse=last)
        if topics is None and contents.counts.keys() <= set(wanted) and parts and parts[0].span_ns != ALWAYS:
            return parts[0].span_ns[last]
        best: int | None = None
        with open_mcap(self.path) as file:
            for part in parts:
                if best is not None and (part.span_ns[1] <= best if last else part.span_ns[0] >= best):
                    break
                _, table = contents.messages(file, part)
                times = table["log_time_ns"][_mask(wanted)[table["channel"]]].tolist()
                best = (max if last else min)([*times, *([] if best is None else [best])], default=None)
        return best or 0

    def _read(self, wanted: list[int], span_ns: tuple[int, int] | None = None) -> Iterator[tuple[bytes, NDArray[Any]]]:
        """Yield every chunk, with the places of the messages of some channels; without any it is not unpacked.

        span_ns: chunks that have no message in it are left out. Raises LogError where a message is missing.
        """
        mask, left, contents = _mask(wanted), sum(self._contents.counts.get(each, 0) for each in wanted), self._contents
        with open_mcap(self.path) as file:
            for part in contents.parts:
                if span_ns and (part.span_ns[1] < span_ns[0] or part.span_ns[0] > span_ns[1]):
                    continue
                if not span_ns and part.channels is not None and part.channels.isdisjoint(wanted):
                    yield b"", np.zeros(0, MESSAGES)
                    continue
                data, table = contents.messages(file, part)
                if part.channels is not None and np.count_nonzero(_mask(table["channel"])) != len(part.channels):
                    raise damaged(self.path, part.section.offset, "the index names other channels than the chunk has")
                table = table[mask[table["channel"]]]
                left -= len(table)
                if left < 0:
                    break
                yield data, table
        if left < 0 or (left and not span_ns):
            raise damaged(self.path, len(MAGIC), "there are not as many messages as the summary counts")


def read_log(path: Path, truncated: bool = False) -> Log:
    """Open a log. `truncated`: read a file without an end as far as it goes.

    Raises LogError, with one clear line: no MCAP file, cut off, damaged, or not a log of ours.
    """
    path = Path(path)
    with open_mcap(path) as file:
        end = end_of(file)
        if end is None and not truncated:
            raise LogError(f"{path} is cut off (no summary): {remedy(path)}")
        if end is None:
            (salvage := Salvage(file)).run()
            contents = salvage.contents
        else:
            contents = read_contents(file, end)
    topics = {channel.topic for channel in contents.channels.values()}
    arms = [contents.schemas.get(each.schema_id) for each in contents.channels.values() if each.topic in ARM_TOPICS]
    ours = any(schema is not None and schema.name == ARM.schema for schema in arms)
    # or of a run that ended before its first tick
    if ours or ({"log", "trial"} & contents.metadata.keys() and topics <= {*TOPICS, *scenery_schemas()}):
        return Log(path, contents, end is not None)
    reason = "has no schema of ours" if arms else "is missing"
    raise LogError(f"{path} is an MCAP file but not a log of ours: topic {' or '.join(ARM_TOPICS)} {reason}")


def _mask(channels: Sequence[int] | NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which channels are meant, by number."""
    mask = np.zeros(NUMBERS, np.bool_)
    mask[channels] = True
    return mask


def _in_order(places: NDArray[np.intp] | None, records: NDArray[Any]) -> NDArray[Any]:
    """Return records in order of time, those of one time in the order of the file: their places in it."""
    if places is not None and (places[1:] < places[:-1]).any():  # of several channels
        records = records[np.argsort(places)]
    t_ns = records["t_ns"]
    return records if (t_ns[1:] >= t_ns[:-1]).all() else records[np.argsort(t_ns, kind="stable")]
