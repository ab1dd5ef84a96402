"""What a log's file holds: where its messages are, and everything small.

By its summary where that accounts for every byte of the data section, else by a look at every chunk.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, ChunkIndex, Metadata, MetadataIndex, Schema, Statistics
from numpy.typing import NDArray

from rtstack.log.errors import LogError, damaged
from rtstack.log.file import container
from rtstack.log.file.container import LOOSE, MAGIC, NUMBERS, RECORD_HEADER, End, Section

_SMALL_MAX = 16 << 20  # bytes of all metadata, and of all schemas and channels; those of our logs have some 100 kB
ALWAYS = (0, (1 << 64) - 1)
_ATTACHMENT = struct.Struct("<BQQQI")  # opcode, length, log time, create time, length of the name


@dataclass(slots=True)
class Part:
    """A chunk, or a run of records outside of chunks. span_ns: log times of its messages, all times where they are not
    known; channels: which it has messages of, None where that is not known; rest: the data of a damaged one."""

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
    small: dict[int, int] = field(default_factory=dict)  # bytes of each kind of small records so far

    def messages(self, file: BinaryIO, part: Part) -> tuple[bytes, NDArray[Any]]:
        """Return a part's data, and where its messages are; keep its schemas and channels. Raises LogError."""
        data = container.section_data(file, part.section) if part.rest is None else part.rest
        table, definitions, conflicts, end = container.walk(data, self.seen)
        try:
            if part.rest is None and end != len(data):
                raise ValueError("a chunk ends inside of a record")
            if part.rest is None and conflicts:
                raise ValueError("a schema or channel has the number of another one")
            for place in definitions:
                self.define(data, place)
        except Exception as error:  # the library raises whatever half a record makes of it
            raise damaged(Path(file.name), part.section.offset, error) from error
        return data, table

    def define(self, data: bytes, place: int) -> None:
        length = int.from_bytes(data[place + 1 : place + RECORD_HEADER], "little")
        self.limit(Opcode.SCHEMA, length)
        body = ReadDataStream(BytesIO(data[place + RECORD_HEADER : place + RECORD_HEADER + length]))
        found = (Schema if data[place] == Opcode.SCHEMA else Channel).read(body)
        (self.schemas if isinstance(found, Schema) else self.channels)[found.id] = found  # type: ignore[assignment]

    def limit(self, kind: int, size: int) -> None:
        """Count what is kept of small records. Raises ValueError where that is too much."""
        self.small[kind] = self.small.get(kind, 0) + size
        if self.small[kind] > _SMALL_MAX:
            raise ValueError(f"more than {_SMALL_MAX} bytes of small records of one kind")

    def add(self, part: Part, table: NDArray[Any]) -> None:
        """Count the messages of a part, and keep it where it has some. Raises ValueError for an unknown channel."""
        numbers, counts = np.unique(table["channel"], return_counts=True)
        for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
            if number not in self.channels:
                raise ValueError(f"a message is of channel {number}, which is not defined")
            self.counts[number] = self.counts.get(number, 0) + count
        if len(table):
            part.channels = frozenset(numbers.tolist())
            part.span_ns = int(table["log_time_ns"].min()), int(table["log_time_ns"].max())
            self.parts.append(part)


@dataclass(slots=True)
class Summary:
    """The summary of a finished file. known: kind, size and name of chunks, attachments and metadata by offset."""

    contents: Contents = field(default_factory=Contents)
    statistics: Statistics | None = None
    chunks: dict[int, ChunkIndex] = field(default_factory=dict)
    known: dict[int, tuple[int, int, str]] = field(default_factory=dict)

    @property
    def whole(self) -> bool:
        """Whether it says how many messages each channel has, and has all schemas and channels."""
        said, found = self.statistics, self.contents
        return (
            said is not None and said.channel_count == len(found.channels) and said.schema_count == len(found.schemas)
            and said.channel_message_counts.keys() <= found.channels.keys()
            and sum(said.channel_message_counts.values()) == said.message_count
        )  # fmt: skip


def _records(data: bytes) -> Iterator[tuple[int, int, ReadDataStream]]:
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
    summary = Summary()
    try:
        if end.summary_crc not in (0, zlib.crc32(data)):
            raise ValueError("the checksum of the summary is wrong")
        for opcode, place, body in _records(content):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                summary.contents.define(content, place)
            elif opcode == Opcode.STATISTICS:
                summary.statistics = Statistics.read(body)
            elif opcode == Opcode.CHUNK_INDEX:
                chunk = ChunkIndex.read(body)
                summary.chunks[chunk.chunk_start_offset] = chunk
                summary.known[chunk.chunk_start_offset] = Opcode.CHUNK, chunk.chunk_length, ""
            elif opcode in (Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX):
                attached = opcode == Opcode.ATTACHMENT_INDEX
                index = (AttachmentIndex if attached else MetadataIndex).read(body)
                kind = Opcode.ATTACHMENT if attached else Opcode.METADATA
                summary.known[index.offset] = kind, index.length, index.name
        container.walk(content, summary.contents.seen)
    except Exception as error:  # the library raises whatever half a record makes of it
        raise damaged(Path(file.name), end.summary, error) from error
    return summary


def read_contents(file: BinaryIO, end: End, trusts: bool = True) -> Contents:
    """Return what a finished file holds; trusts: by the summary, where that says enough and has a checksum.

    Raises LogError for a file that is damaged, or that expands to more than `growth_max`.
    """
    summary = read_summary(file, end)
    if trusts and end.summary_crc and summary.whole:
        try:
            return _Survey(file, end, summary, trusts=True).contents
        except Inconsistent:  # an index is missing, or wrong
            pass
    return _Survey(file, end, summary, trusts=False).contents


class _Survey:
    """One way through the data section of a finished file, from record to record."""

    def __init__(self, file: BinaryIO, end: End, summary: Summary, trusts: bool) -> None:
        self._file, self._path, self._summary, self._trusts = file, Path(file.name), summary, trusts
        self.contents = summary.contents if trusts else Contents()
        self._left = container.growth_max(file.seek(0, 2))
        self._kinds: dict[int, int] = {}  # of what an index may name, by offset
        offset = len(MAGIC)
        while offset < end.data:
            try:
                section = container.section_at(file, offset, end.data)
                self._add(section)
            except LogError:
                raise
            except Exception as error:  # the library raises whatever half a record makes of it
                self._refuse(offset, error)
                raise
            offset = section.end
        self._compare(end.summary)

    def _refuse(self, offset: int, cause: object) -> None:
        raise Inconsistent if self._trusts else damaged(self._path, offset, cause)

    def _add(self, section: Section) -> None:
        if section.opcode == Opcode.DATA_END:
            raise ValueError("the data end before the summary")
        if section.opcode in (Opcode.CHUNK, Opcode.METADATA, Opcode.ATTACHMENT):
            self._kinds[section.offset] = section.opcode
        if section.opcode == Opcode.CHUNK:
            self._add_chunk(section)
        elif section.opcode in LOOSE:
            self._add_messages(section)
        elif section.opcode == Opcode.METADATA:
            self.contents.limit(Opcode.METADATA, section.size)
            metadata = metadata_at(self._file, section)
            self.contents.metadata[metadata.name] = metadata.metadata
        elif section.opcode == Opcode.ATTACHMENT:
            self.contents.attachments.append(attachment_at(self._file, section))

    def _add_chunk(self, section: Section) -> None:
        """Add a chunk; where the summary is trusted, as that has it, without unpacking it."""
        head = container.chunk_at(self._file, section, head=True)
        self._left -= head.uncompressed_size
        if self._left < 0:
            raise LogError(f"{self._path} is not read: its chunks expand to far more than its size")
        if not self._trusts:
            self._add_messages(section)
            return
        said, span = self._summary.chunks.get(section.offset), (head.message_start_time, head.message_end_time)
        there = section.size, *span, head.uncompressed_size, head.compression
        if said is None or there != (
            said.chunk_length, said.message_start_time, said.message_end_time, said.uncompressed_size, said.compression
        ):  # fmt: skip
            raise Inconsistent
        known = span[0] <= span[1] and span != (0, 0)  # (0, 0): of a writer that leaves them out
        channels = frozenset(said.message_index_offsets) or None
        self.contents.parts.append(Part(section, span if known else ALWAYS, channels))

    def _add_messages(self, section: Section) -> None:
        part = Part(section)
        table = self.contents.messages(self._file, part)[1]
        if self._trusts and len(table):
            raise Inconsistent  # messages outside of chunks are in no index
        self.contents.add(part, table)

    def _compare(self, place: int) -> None:
        """Refuse a file that has not what its summary, at this place, counts and names."""
        for offset, (kind, _, _) in self._summary.known.items():
            if self._kinds.get(offset) != kind:
                self._refuse(offset, "the summary names a record here, and there is none")
        said = self._summary.statistics
        if said is None:
            return
        counts = {number: count for number, count in said.channel_message_counts.items() if count}
        if self._trusts:
            self.contents.counts = counts
        if counts and counts != self.contents.counts:
            self._refuse(place, "the summary counts other messages of the channels than there are")
        kinds = list(self._kinds.values())
        for name, count, there in (
            ("messages", said.message_count, sum(self.contents.counts.values())),
            ("chunks", said.chunk_count, kinds.count(Opcode.CHUNK)),
            ("attachments", said.attachment_count, kinds.count(Opcode.ATTACHMENT)),
            ("metadata records", said.metadata_count, kinds.count(Opcode.METADATA)),
        ):
            if count != there:
                self._refuse(place, f"the summary counts {count} {name}, and {there} are there")


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
