"""A log that was cut off or damaged, made whole: what can be read in it is written anew."""

import mmap
import re
import zlib
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import numpy as np
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Statistics,
)  # fmt: skip

from hal.base.files import replacing
from hal.compilation import compiled
from rtstack.log.errors import LogError
from rtstack.log.file.container import (
    DATA_END_SIZE,
    LOOSE,
    MAGIC,
    MESSAGE_HEADER,
    RECORD_HEADER,
    End,
    MessageTable,
    Section,
    chunk_at,
    chunk_data,
    end_of,
    growth_max,
    open_mcap,
    section_at,
    section_data,
    walk,
)  # fmt: skip
from rtstack.log.file.contents import (
    Contents,
    Summary,
    attachment_at,
    attachment_data,
    metadata_at,
    read_contents,
    read_summary,
    rest_of,
)  # fmt: skip

_CRC_AT = RECORD_HEADER + 24  # of a chunk: behind two times and its size
_CHAIN = 3  # so many records in a row are no accident
_LEAST = np.array([0, 8, 20, 14, 12, 22, 40, 6, 60, 36, 56, 46, 8, 20, 17, 4])  # bytes of a record, by its opcode
_NS = 1e-9


@dataclass(frozen=True, slots=True)
class RecoverySummary:
    """What a recovery gave back. A complete log needs none: `complete`, and no `output`.

    messages: in the new file; last_t_ns: the newest log time, ns; damaged: records that could not be read;
    missing: a line for each of them.
    """

    output: Path | None
    complete: bool
    messages: int = 0
    last_t_ns: int = 0
    damaged: int = 0
    missing: tuple[str, ...] = ()


def recover(
    path: Path, output: Path | None = None, progress: Callable[[int, int], None] | None = None
) -> RecoverySummary:
    """Copy everything that can be read of `path` into a new, complete file, unless all of it can be.

    output: NAME.recovered.mcap beside the original by default; must not exist. The original is never touched.
    progress: called with bytes done and bytes in all. Raises LogError, also where no message is left: then nothing
    is written.
    """
    path = Path(path)
    with open_mcap(path, any_start=True) as source:
        if _is_whole(source):
            return RecoverySummary(None, complete=True)
        output = path.with_suffix(".recovered.mcap") if output is None else Path(output)
        if output.exists():
            raise LogError(f"{output} exists already: remove it, or choose another name")
        try:
            with replacing(output) as partial, open(partial, "wb") as target:
                copy = _Copy(source, _Target(target))
                copy.add_all(progress or (lambda done, total: None))
                found = copy.finish(output)
        except OSError as error:
            raise LogError(f"cannot write {output}: {error.strerror}") from error
    return found


def _is_whole(file: BinaryIO) -> bool:
    """Whether everything in a file can be read: the counts of its summary, and every checksum that it has."""
    end = end_of(file)
    file.seek(0)
    if end is None or file.read(len(MAGIC)) != MAGIC:
        return False
    try:
        contents, counts = read_contents(file, end), dict[int, int]()
        for part in contents.parts:
            _, table = contents.messages(file, part)
            for number, count in zip(*np.unique(table.channel_id, return_counts=True), strict=True):
                counts[int(number)] = counts.get(int(number), 0) + int(count)
        for place in contents.attachments:
            attachment_data(file, place)
    except LogError:
        return False
    if {number: count for number, count in contents.counts.items() if count} != counts:
        return False
    file.seek(end.data + RECORD_HEADER)
    wanted = int.from_bytes(file.read(4), "little")
    return wanted in (0, _checksum(file, end.data))


def _checksum(file: BinaryIO, end: int) -> int:
    file.seek(0)
    crc = 0
    while block := file.read(min(1 << 20, end - file.tell())):
        crc = zlib.crc32(block, crc)
    return crc


class _Target:
    """The new file: chunks, attachments and metadata with their indexes."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._at, self._crc = file, 0, 0
        self._index: list[McapRecord] = []
        self.counts: dict[int, int] = {}
        self.span_ns = (1 << 64) - 1, 0
        self.put(MAGIC)

    def put(self, *records: McapRecord | bytes) -> int:
        """Write records; return where the first one begins."""
        builder, begin = RecordBuilder(), self._at
        for record in records:
            builder.write(record) if isinstance(record, bytes) else record.write(builder)
        data = builder.end()
        self._file.write(data)
        self._at, self._crc = begin + len(data), zlib.crc32(data, self._crc)
        return begin

    def put_metadata(self, metadata: Metadata) -> None:
        """Write a metadata record."""
        begin = self.put(metadata)
        self._index.append(MetadataIndex(begin, self._at - begin, metadata.name))

    def put_attachment(self, place: AttachmentIndex, data: bytes) -> None:
        """Write an attachment."""
        begin = self.put(Attachment(place.create_time, place.log_time, place.name, place.media_type, data))
        self._index.append(AttachmentIndex(
            begin, self._at - begin, place.log_time, place.create_time, len(data), place.name, place.media_type
        ))  # fmt: skip

    def put_chunk(self, data: bytes, table: MessageTable) -> None:
        """Write the data of a chunk, and the index of its messages."""
        times = table.log_time_ns
        span = (int(times.min()), int(times.max())) if len(times) else (0, 0)
        packed = lz4.frame.compress(data)
        begin = self.put(Chunk("lz4", packed, span[1], span[0], zlib.crc32(data), len(data)))
        end, offsets = self._at, dict[int, int]()
        for number in np.unique(table.channel_id).tolist():
            mine = table.rows(table.channel_id == number)
            entries = np.stack([mine.log_time_ns, (mine.start - MESSAGE_HEADER).view(np.uint64)], axis=1).tobytes()
            head = bytes([Opcode.MESSAGE_INDEX]) + (len(entries) + 6).to_bytes(8, "little")
            sizes = number.to_bytes(2, "little") + len(entries).to_bytes(4, "little")
            offsets[number] = self.put(head + sizes + entries)
            self.counts[number] = self.counts.get(number, 0) + len(mine.start)
        self._index.append(ChunkIndex(
            chunk_length=end - begin, chunk_start_offset=begin, compression="lz4", compressed_size=len(packed),
            message_start_time=span[0], message_end_time=span[1], message_index_length=self._at - end,
            message_index_offsets=offsets, uncompressed_size=len(data),
        ))  # fmt: skip
        if len(times):
            self.span_ns = min(self.span_ns[0], span[0]), max(self.span_ns[1], span[1])

    def finish(self, contents: Contents) -> None:
        """Write the end of the data, the summary and the footer."""
        begin = self.put(DataEnd(self._crc)) + DATA_END_SIZE
        self._crc = 0
        kinds = [type(each) for each in self._index]
        first_ns, last_ns = self.span_ns if self.counts else (0, 0)
        self.put(*contents.raw.values(), *self._index, Statistics(
            attachment_count=kinds.count(AttachmentIndex), channel_count=len(contents.channels),
            channel_message_counts=self.counts, chunk_count=kinds.count(ChunkIndex),
            message_count=sum(self.counts.values()), message_start_time=first_ns, message_end_time=last_ns,
            metadata_count=kinds.count(MetadataIndex), schema_count=len(contents.schemas),
        ))  # fmt: skip
        builder = RecordBuilder()
        Footer(begin, 0, 0).write(builder)
        crc = zlib.crc32(builder.end()[:-4], self._crc)
        self.put(Footer(begin, 0, crc), MAGIC)


class _Copy:
    """What can be read in a file, on its way into a new one."""

    def __init__(self, source: BinaryIO, target: _Target) -> None:
        self._source, self._target, self._path = source, target, Path(source.name)
        end, size = end_of(source, any_data_end=True), source.seek(0, 2)
        self._stop = size if end is None else end.data
        self._magic: list[int] | None = None  # where there are files in the file
        self._summary = self._read_summary(end)
        self._contents = self._summary.contents
        self._left = growth_max(size)
        self._missing: list[str] = []
        self._lost: list[Section] = []  # what could not be read last, until what it had is known
        self._indexed: dict[int, tuple[int, int, int]] = {}  # messages of that chunk by channel: count, log times

    def _read_summary(self, end: End | None) -> Summary:
        if end is None:
            return Summary(Contents())
        try:
            found = read_summary(self._source, end)
        except LogError:
            return Summary(Contents())
        if not end.summary_crc:  # without a checksum, what it names is looked at
            for offset, (kind, size, _) in [*found.known.items()]:
                self._source.seek(offset)
                if self._source.read(RECORD_HEADER) != bytes([kind]) + max(size - RECORD_HEADER, 0).to_bytes(
                    8, "little"
                ):
                    del found.known[offset]
        return found

    def add_all(self, progress: Callable[[int, int], None]) -> None:
        """Copy what there is. progress: see `recover`."""
        known, offset = sorted(self._summary.known), len(MAGIC)
        self._target.put(self._header())
        self._target.put(*self._contents.raw.values())  # their chunk may be the damaged one
        while offset < self._stop:
            place = bisect_right(known, offset)
            offset = self._add_at(offset, known[place] if place < len(known) else self._stop)
            progress(min(offset, self._stop), self._stop)
        self._report_lost()
        if not self._target.counts:
            what = f", and {len(self._missing)} chunks that cannot be read" if self._missing else ""
            raise LogError(f"{self._path} holds nothing to recover: no complete message{what}; nothing was written")

    def _header(self) -> Header:
        try:
            self._source.seek(len(MAGIC) + RECORD_HEADER)
            return Header.read(ReadDataStream(self._source))
        except Exception:  # the library raises whatever half a record makes of it
            return Header("", "")

    def _add_at(self, offset: int, following: int) -> int:
        """Copy what stands at a place; return where to go on. following: where the summary names the next record."""
        kind, size, _ = self._summary.known.get(offset, (0, 0, ""))
        if kind and size and offset + size <= self._stop:
            self._add(Section(kind, offset, size))
            return offset + size
        try:
            section = section_at(self._source, offset, self._stop)
        except ValueError:
            return self._go_on(offset, following)
        if (section.opcode, section.size) == (Opcode.DATA_END, DATA_END_SIZE):
            return self._stop
        if section.opcode in LOOSE and not self._fits(section.end):  # the last record's length may be what is wrong
            data = section_data(self._source, section)
            place = max(0, int(walk(data, self._contents.seen.copy()).table.start[-1:].sum()) - MESSAGE_HEADER)
            self._add(Section(section.opcode, offset, place))
            return self._go_on(offset + place, following)
        if section.end > following or not (self._add(section) or self._fits(section.end)):
            return self._go_on(offset, following)
        return section.end

    def _fits(self, offset: int) -> bool:
        """Whether a record may begin at a place."""
        try:
            return offset >= self._stop or section_at(self._source, offset, self._stop).size > 0
        except ValueError:
            return False

    def _go_on(self, offset: int, following: int) -> int:
        """Return where records go on behind a damaged one. Of a chunk, copy what can be had."""
        found = following if following < self._stop else self._search(offset + 1)
        chunk = Section(Opcode.CHUNK, offset, found - offset)
        self._lost = [each for each in self._lost if each.offset != offset]
        if not (data := rest_of(self._source, chunk)):
            self._lose(Section(0, offset, found - offset))
            return found
        self._left -= len(data)
        self._copy(data if self._left > 0 else b"", chunk)
        return found

    def _search(self, offset: int) -> int:
        """Return where records go on, found by what they look like; an attached MCAP file is passed over."""
        with mmap.mmap(self._source.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
            if self._magic is None:
                self._magic = [each.start() for each in re.finditer(re.escape(MAGIC), mapped)]
            inner = [each for each in self._magic if offset <= each < self._stop][:2]
            found = _plausible(np.frombuffer(mapped[: self._stop], np.uint8), offset, *inner[:1] or [self._stop])
        if found >= 0 or not inner:
            return found if found >= 0 else self._stop
        return self._stop if len(inner) == 1 else self._search(inner[1] + len(MAGIC))

    def _add(self, section: Section) -> bool:
        """Copy one section; count it where it cannot be read, and return False."""
        try:
            if section.opcode == Opcode.MESSAGE_INDEX:
                self._keep_index(section)
            elif section.opcode == Opcode.CHUNK:
                self._copy(self._chunk(section), section)
            elif section.opcode in LOOSE:
                self._copy(section_data(self._source, section), section)
            elif section.opcode == Opcode.METADATA:
                self._contents.limit(Opcode.METADATA, section.size)
                self._target.put_metadata(metadata_at(self._source, section))
            elif section.opcode == Opcode.ATTACHMENT:
                place = attachment_at(self._source, section)
                self._target.put_attachment(place, attachment_data(self._source, place))
        except OSError:
            raise
        except Exception:  # the library raises whatever half a record makes of it, and each decompressor its own error
            self._lose(section)
            return False
        return True

    def _chunk(self, section: Section) -> bytes:
        """Return the data of a chunk, by the summary where that has it: a head that is damaged does no harm."""
        if (said := self._summary.chunks.get(section.offset)) is None:
            chunk = chunk_at(self._source, section)
        else:
            self._source.seek(section.offset)
            raw = self._source.read(section.size)
            crc = int.from_bytes(raw[_CRC_AT : _CRC_AT + 4], "little")
            data = raw[max(0, len(raw) - said.compressed_size) :]
            chunk = Chunk(said.compression, data, 0, 0, crc, said.uncompressed_size)
        self._left -= chunk.uncompressed_size
        if self._left < 0:
            raise ValueError("the chunks expand to far more than the file's size")
        crc, chunk.uncompressed_crc = chunk.uncompressed_crc, 0
        data = chunk_data(chunk)
        if crc and (crc ^ zlib.crc32(data)).bit_count() > 1:  # one bit: the checksum itself is what is damaged
            raise ValueError("a chunk's checksum is wrong")
        return data

    def _copy(self, data: bytes, section: Section) -> None:
        """Write the complete schemas, channels and messages of a chunk's data."""
        contents, found = self._contents, walk(data, self._contents.seen)
        table, definitions, broken = found.table, list[bytes](), bool(found.conflicts)
        for place in found.definitions:
            try:
                contents.define(data, place)
                definitions.append([*contents.raw.values()][-1])
            except Exception:  # whatever half a record makes of it
                broken = True
        unknown = [each for each in np.unique(table.channel_id).tolist() if each not in contents.channels]
        data = data[: found.end]
        if unknown or broken:  # a damaged chunk had their schema, without which no program can read them
            kept = table.rows(~np.isin(table.channel_id, unknown))
            if lost := len(table.start) - len(kept.start):
                self._missing.append(f"{lost} messages of channels that are not defined, at byte {section.offset}")
            spans = zip((kept.start - MESSAGE_HEADER).tolist(), (kept.start + kept.size).tolist(), strict=True)
            data = b"".join([*definitions, *(data[start:end] for start, end in spans)])
            table = walk(data, contents.seen).table
        if definitions or len(table.start):
            self._target.put_chunk(data, table)

    def _keep_index(self, section: Section) -> None:
        """Count what the chunk had that could not be read."""
        if not self._lost:
            return
        self._source.seek(section.offset + RECORD_HEADER)
        body = self._source.read(section.size - RECORD_HEADER)
        times = np.frombuffer(body[6 : 6 + (len(body) - 6) // 16 * 16], np.uint64)[::2]
        if len(times):
            self._indexed[int.from_bytes(body[:2], "little")] = len(times), int(times.min()), int(times.max())

    def _lose(self, section: Section) -> None:
        self._report_lost()
        self._lost = [section]

    def _report_lost(self) -> None:
        """Say in a line what was lost."""
        for section in self._lost:
            kind = {Opcode.CHUNK: "a chunk", Opcode.METADATA: "metadata", Opcode.ATTACHMENT: "the attachment"}
            name = self._summary.known.get(section.offset, (0, 0, ""))[2]
            line = f"{kind.get(Opcode(section.opcode), 'records') if section.opcode else 'records'} {name}".strip()
            line += f" at bytes {section.offset} to {section.end}"
            if self._indexed:
                counts, first_ns, last_ns = zip(*self._indexed.values(), strict=True)
                channels = self._contents.channels
                topics = sorted({channels[each].topic for each in self._indexed if each in channels})
                line += f": {sum(counts)} messages of {', '.join(topics) or 'unknown topics'}"
                line += f" from {min(first_ns) * _NS:.3f} to {max(last_ns) * _NS:.3f} s"
            self._missing.append(line)
        self._lost, self._indexed = [], {}

    def finish(self, output: Path) -> RecoverySummary:
        """Write the metadata record `recovery`, the end of the data, the summary and the footer."""
        messages, missing = sum(self._target.counts.values()), tuple(self._missing)
        said = {"source": self._path.name, "damaged_chunks": str(len(missing)), "messages": str(messages)}
        self._target.put_metadata(Metadata("recovery", said | ({"missing": "; ".join(missing)} if missing else {})))
        self._target.finish(self._contents)
        return RecoverySummary(output, False, messages, self._target.span_ns[1], len(missing), missing)


@compiled
def _plausible(data, offset, limit):
    """Return where several records in a row begin, from an offset to before a limit; -1: nowhere."""
    for begin in range(offset, limit):
        place, links = begin, 0
        while links < _CHAIN and place + RECORD_HEADER <= len(data):
            opcode, length = np.int64(data[place]), np.int64(0)
            for k in range(8):
                length |= np.int64(data[place + 1 + k]) << (8 * k)
            if opcode == 0 or opcode >= len(_LEAST) or length < _LEAST[opcode]:
                break
            if length > len(data) - place - RECORD_HEADER:
                break
            place += RECORD_HEADER + length
            links += 1
        if links == _CHAIN or (links > 0 and place == len(data)):
            return begin
    return -1
