"""What a log's file holds: where its messages are, and everything small.

By its summary where that accounts for every byte of the data section, else by a look at every chunk.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, Chunk, ChunkIndex, Metadata, MetadataIndex, Schema, Statistics
from numpy.typing import NDArray

from rtstack.log.errors import LogError, damaged
from rtstack.log.file.container import (
    LOOSE,
    MAGIC,
    NUMBERS,
    RECORD_HEADER,
    End,
    MessageTable,
    Section,
    chunk_at,
    decompressed,
    growth_max,
    section_at,
    section_data,
    walk,
)  # fmt: skip

_SMALL_MAX = 16 << 20  # bytes of all metadata, and of all schemas and channels; those of our logs have some 100 kB
ALWAYS = (0, (1 << 64) - 1)
_ATTACHMENT = struct.Struct("<BQQQI")  # opcode, length, log time, create time, length of the name


@dataclass(slots=True)
class Part:
    """A chunk, or a run of records outside of chunks. span_ns: log times of its messages, all times where they are not
    known; channels: which it has messages of, None where that is not known; rest: data of a chunk that is cut off."""

    section: Section
    span_ns: tuple[int, int] = ALWAYS
    channels: frozenset[int] | None = None
    rest: bytes | None = None


class Inconsistent(Exception):
    """The summary does not account for what is there."""


@dataclass(slots=True)
class Contents:
    """counts: messages of each channel. attachments: where they are, each with its name."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    seen: NDArray[np.int64] = field(default_factory=lambda: np.zeros(2 * NUMBERS, np.int64))
    raw: dict[tuple[int, int], bytes] = field(default_factory=dict)  # schemas and channels, by kind and number
    small: dict[int, int] = field(default_factory=dict)  # bytes of each kind of small records so far

    def messages(self, file: BinaryIO, part: Part) -> tuple[bytes, MessageTable]:
        """Return a part's data, and where its messages are. Raises LogError where it is damaged."""
        data = section_data(file, part.section) if part.rest is None else part.rest
        return data, self.take(data, part, Path(file.name))

    def take(self, data: bytes, part: Part, path: Path) -> MessageTable:
        """Return where the messages of a part are; keep the schemas and channels that it defines. Raises LogError."""
        found, offset = walk(data, self.seen), part.section.offset
        if part.rest is None and found.end != len(data):
            raise damaged(path, offset, "a chunk ends inside of a record")
        if found.conflicts:
            raise damaged(path, offset, "a schema or channel has the number of another one")
        try:
            for place in found.definitions:
                self.define(data, place)
        except Exception as error:  # the library raises whatever half a record makes of it
            raise damaged(path, offset, error) from error
        return found.table

    def define(self, data: bytes, place: int) -> None:
        """Keep the schema or channel at this place."""
        length = int.from_bytes(data[place + 1 : place + RECORD_HEADER], "little")
        body = data[place + RECORD_HEADER : place + RECORD_HEADER + length]
        self.limit(Opcode.SCHEMA, length)
        kind = Schema if data[place] == Opcode.SCHEMA else Channel
        found = kind.read(ReadDataStream(BytesIO(body)))
        (self.schemas if isinstance(found, Schema) else self.channels)[found.id] = found  # type: ignore[assignment]
        self.raw[data[place], found.id] = data[place : place + RECORD_HEADER + length]

    def limit(self, kind: int, size: int) -> None:
        """Count what is kept of small records. Raises ValueError where that is too much."""
        self.small[kind] = self.small.get(kind, 0) + size
        if self.small[kind] > _SMALL_MAX:
            raise ValueError(f"more than {_SMALL_MAX} bytes of small records of one kind")

    def count(self, table: MessageTable, strict: bool) -> frozenset[int]:
        """Count the messages of a part; return their channels. strict: raise ValueError for one that is not defined."""
        numbers, counts = np.unique(table.channel_id, return_counts=True)
        found = dict(zip(numbers.tolist(), counts.tolist(), strict=True))
        if strict and (unknown := found.keys() - self.channels.keys()):
            raise ValueError(f"a message is of channel {min(unknown)}, which is not defined")
        for number in found.keys() & self.channels.keys():
            self.counts[number] = self.counts.get(number, 0) + found[number]
        return frozenset(found)


@dataclass(slots=True)
class Summary:
    """The summary of a finished file. known: kind, size and name of chunks, attachments and metadata by offset."""

    contents: Contents
    statistics: Statistics | None = None
    chunks: dict[int, ChunkIndex] = field(default_factory=dict)
    known: dict[int, tuple[int, int, str]] = field(default_factory=dict)

    @property
    def whole(self) -> bool:
        """Whether it says how many messages each channel has, and has all schemas and channels."""
        said, found = self.statistics, self.contents
        return (
            said is not None and said.channel_count == len(found.channels) and said.schema_count == len(found.schemas)
            and said.chunk_count == len(self.chunks)
            and said.channel_message_counts.keys() <= found.channels.keys()
            and sum(said.channel_message_counts.values()) == said.message_count
        )  # fmt: skip


def records_of(data: bytes) -> Iterator[tuple[int, int, ReadDataStream]]:
    """Yield the kind, place and content of each record of a summary."""
    place = 0
    while place < len(data):
        length = int.from_bytes(data[place + 1 : place + RECORD_HEADER], "little")
        if not data[place] or length > len(data) - place - RECORD_HEADER:
            raise ValueError("what the summary has here is no record")
        body = data[place + RECORD_HEADER : place + RECORD_HEADER + length]
        yield data[place], place, ReadDataStream(BytesIO(body))
        place += RECORD_HEADER + length


def read_summary(file: BinaryIO, end: End) -> Summary:
    """Return the summary of a finished file. Raises LogError where it is damaged."""
    file.seek(end.summary)
    data = file.read(end.footer + RECORD_HEADER + 16 - end.summary)
    content = data[: end.footer - end.summary]
    summary = Summary(Contents())
    try:
        if end.summary_crc not in (0, zlib.crc32(data)):
            raise ValueError("the checksum of the summary is wrong")
        for opcode, place, body in records_of(content):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                summary.contents.define(content, place)
            elif opcode == Opcode.STATISTICS:
                summary.statistics = Statistics.read(body)
            elif opcode == Opcode.CHUNK_INDEX:
                chunk = ChunkIndex.read(body)
                summary.chunks[chunk.chunk_start_offset] = chunk
                summary.known[chunk.chunk_start_offset] = Opcode.CHUNK, chunk.chunk_length, ""
            elif opcode == Opcode.ATTACHMENT_INDEX:
                index = AttachmentIndex.read(body)
                summary.known[index.offset] = Opcode.ATTACHMENT, index.length, index.name
            elif opcode == Opcode.METADATA_INDEX:
                index = MetadataIndex.read(body)
                summary.known[index.offset] = Opcode.METADATA, index.length, index.name
        walk(content, summary.contents.seen)
    except Exception as error:  # the library raises whatever half a record makes of it
        raise damaged(Path(file.name), end.summary, error) from error
    return summary


def read_contents(file: BinaryIO, end: End | None) -> Contents:
    """Return what a file holds; without an end as far as it goes, without what is damaged.

    Raises LogError for a finished file that is damaged, or that expands to more than `growth_max`.
    """
    summary = None if end is None else read_summary(file, end)
    if summary is not None and summary.whole:
        try:
            return _Survey(file, end, summary, trusted=True).contents
        except Inconsistent:  # an index is missing, or wrong
            pass
    return _Survey(file, end, summary, trusted=False).contents


class _Survey:
    """One way through the data section, from record to record."""

    def __init__(self, file: BinaryIO, end: End | None, summary: Summary | None, trusted: bool) -> None:
        self._file, self._path, self._end = file, Path(file.name), end
        self._summary, self._trusted = summary or Summary(Contents()), trusted
        self.contents = self._summary.contents if trusted else Contents()
        size = file.seek(0, 2)
        self._left = growth_max(size)
        self._visited: dict[int, int] = {}  # offsets and kinds of what an index may name
        self._through(len(MAGIC), size if end is None else end.data)
        self._compare()

    def _through(self, offset: int, stop: int) -> None:
        while offset < stop:
            try:
                section = section_at(self._file, offset, stop)
                if section.opcode == Opcode.DATA_END:
                    raise ValueError("the data end before the summary")
            except ValueError as error:
                self._refuse(offset, error)
                self._add_rest(Section(Opcode.CHUNK, offset, stop - offset))
                return
            offset = section.end
            try:
                self._add(section)
            except (LogError, Inconsistent):
                raise
            except Exception as error:  # the library raises whatever half a record makes of it
                self._refuse(section.offset, error)

    def _refuse(self, offset: int, cause: object) -> None:
        """Raise, but for a file that was cut off: what is damaged in it is left out."""
        if self._trusted:
            raise Inconsistent
        if self._end is not None:
            raise damaged(self._path, offset, cause)

    def _add(self, section: Section) -> None:
        if section.opcode in (Opcode.CHUNK, Opcode.METADATA, Opcode.ATTACHMENT):
            self._visited[section.offset] = section.opcode
        head = chunk_at(self._file, section, head=True) if section.opcode == Opcode.CHUNK else None
        self._spend(0 if head is None else head.uncompressed_size)
        if head is not None and self._trusted:
            self._add_indexed(section, head)
        elif section.opcode == Opcode.CHUNK or section.opcode in LOOSE:
            self._add_part(Part(section))
        elif section.opcode == Opcode.METADATA:
            self.contents.limit(Opcode.METADATA, section.size)
            metadata = metadata_at(self._file, section)
            self.contents.metadata[metadata.name] = metadata.metadata
        elif section.opcode == Opcode.ATTACHMENT:
            self.contents.attachments.append(attachment_at(self._file, section))

    def _add_indexed(self, section: Section, head: Chunk) -> None:
        """Add a chunk as the summary has it, without unpacking it."""
        said, span = self._summary.chunks.get(section.offset), (head.message_start_time, head.message_end_time)
        if said is None or (said.chunk_length, said.message_start_time, said.message_end_time) != (section.size, *span):
            raise Inconsistent
        if (said.uncompressed_size, said.compression) != (head.uncompressed_size, head.compression):
            raise Inconsistent
        known = span[0] <= span[1] and span != (0, 0)  # (0, 0): of a writer that leaves them out
        channels = frozenset(said.message_index_offsets) or None
        self.contents.parts.append(Part(section, span if known else ALWAYS, channels))

    def _add_part(self, part: Part) -> None:
        try:
            _, table = self.contents.messages(self._file, part)
        except LogError:
            if self._end is not None:
                raise
            return
        part.channels = self.contents.count(table, strict=self._end is not None)
        if part.channels:
            if self._trusted:
                raise Inconsistent  # messages outside of chunks are in no index
            part.span_ns = int(table.log_time_ns.min()), int(table.log_time_ns.max())
            self.contents.parts.append(part)

    def _spend(self, size: int) -> None:
        self._left -= size
        if self._left < 0:
            raise LogError(f"{self._path} is not read: its chunks expand to far more than its size")

    def _add_rest(self, section: Section) -> None:
        """Add the chunk that the end of the file cuts off."""
        if data := rest_of(self._file, section):
            self._add_part(Part(section, rest=data))

    def _compare(self) -> None:
        """Refuse a file that has not what its summary counts and names."""
        for offset, (kind, _, _) in self._summary.known.items():
            if self._visited.get(offset) != kind:
                self._refuse(offset, "the summary names a record here, and there is none")
        said = self._summary.statistics
        if said is None:
            return
        if self._trusted:
            self.contents.counts = dict(said.channel_message_counts)
        kinds = list(self._visited.values())
        for name, count, there in (
            ("messages", said.message_count, sum(self.contents.counts.values())),
            ("chunks", said.chunk_count, kinds.count(Opcode.CHUNK)),
            ("attachments", said.attachment_count, kinds.count(Opcode.ATTACHMENT)),
            ("metadata records", said.metadata_count, kinds.count(Opcode.METADATA)),
        ):
            if count != there:
                offset = len(MAGIC) if self._end is None else self._end.summary
                self._refuse(offset, f"the summary counts {count} {name}, and {there} are there")


def rest_of(file: BinaryIO, section: Section) -> bytes:
    """Return the data that can be had of a chunk that is cut off, or whose length is wrong, else none."""
    file.seek(section.offset)
    if file.read(1) != bytes([Opcode.CHUNK]):
        return b""
    try:
        chunk = chunk_at(file, section, cut=True)
        data = decompressed(chunk.data, chunk.compression)
    except Exception:  # whatever a decoder makes of half a record
        return b""
    whole = len(data) >= chunk.uncompressed_size
    return b"" if whole and chunk.uncompressed_crc not in (0, zlib.crc32(data)) else data


def metadata_at(file: BinaryIO, section: Section) -> Metadata:
    """Return a metadata record. Raises whatever the library makes of a broken one."""
    file.seek(section.offset + RECORD_HEADER)
    return Metadata.read(ReadDataStream(BytesIO(file.read(section.size - RECORD_HEADER))))


def attachment_at(file: BinaryIO, section: Section) -> AttachmentIndex:
    """Return what stands before an attachment's data. Raises ValueError or struct.error where that does not fit."""
    file.seek(section.offset)
    _, _, log_ns, made_ns, size = _ATTACHMENT.unpack(file.read(_ATTACHMENT.size))
    name = file.read(min(size, _SMALL_MAX)).decode()
    kind_size = int.from_bytes(file.read(4), "little")
    kind = file.read(min(kind_size, _SMALL_MAX)).decode()
    data_size = int.from_bytes(file.read(8), "little")
    there = section.size - _ATTACHMENT.size - size - 4 - kind_size - 8 - 4  # the checksum
    if data_size != there:
        raise ValueError(f"an attachment says that it has {data_size} bytes, and has {there}")
    return AttachmentIndex(section.offset, section.size, log_ns, made_ns, data_size, name, kind)


def attachment_data(file: BinaryIO, place: AttachmentIndex) -> bytes:
    """Return an attachment's data. Raises LogError where its checksum is wrong."""
    file.seek(place.offset + RECORD_HEADER)
    body = file.read(place.length - RECORD_HEADER)
    if int.from_bytes(body[-4:], "little") not in (0, zlib.crc32(body[:-4])):
        raise damaged(Path(file.name), place.offset, f"the checksum of the attachment {place.name} is wrong")
    return body[-4 - place.data_size : -4]
