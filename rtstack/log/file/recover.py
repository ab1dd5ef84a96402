"""A log that was cut off or damaged, made whole: what can be read in it is written anew, by the library's writer."""

import contextlib
import mmap
import re
import zlib
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk, Header
from mcap.writer import CompressionType, Writer

from hal.base.files import replacing
from hal.compilation import compiled
from rtstack.log.errors import LogError
from rtstack.log.file import container
from rtstack.log.file.container import LOOSE, MAGIC, MESSAGE, RECORD_HEADER, Section, section_at
from rtstack.log.file.contents import Contents, Summary, attachment_at, attachment_data, metadata_at, rest_of
from rtstack.log.file.contents import read_contents as contents_of
from rtstack.log.file.contents import read_summary as summary_of

_CRC_AT = RECORD_HEADER + 24  # of a chunk: behind two times and its size
_CHAIN = 3  # so many records in a row are no accident
_LEAST = np.array([0, 8, 20, 14, 12, 22, 40, 6, 60, 36, 56, 46, 8, 20, 17, 4])  # bytes of a record, by its opcode
_NAMES = {Opcode.CHUNK: "a chunk", Opcode.METADATA: "metadata", Opcode.ATTACHMENT: "the attachment"}
_MESSAGE_BYTES = 160  # what Python needs for one message


@dataclass(frozen=True, slots=True)
class RecoverySummary:
    """What a recovery gave back. A complete log needs none: `complete`, and no `output`.

    messages: in the new file; last_t_ns: the newest log time, ns; missing: a line for each part that could not be read.
    """

    output: Path | None
    complete: bool
    messages: int = 0
    last_t_ns: int = 0
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
    with container.open_mcap(path, any_start=True) as source:
        if _is_whole(source):
            return RecoverySummary(None, complete=True)
        output = path.with_suffix(".recovered.mcap") if output is None else Path(output)
        if output.exists():
            raise LogError(f"{output} exists already: remove it, or choose another name")
        try:
            with replacing(output) as partial, open(partial, "wb") as target:
                copy = _Copy(source, target)
                copy.add_all(progress or (lambda done, total: None))
                return copy.finish(output)
        except OSError as error:
            raise LogError(f"cannot write {output}: {error.strerror}") from error


def _is_whole(file: BinaryIO) -> bool:
    """Whether everything in a file can be read: the counts of its summary, and every checksum that it has."""
    end, crc = container.end_of(file), 0
    file.seek(0)
    if end is None or file.read(len(MAGIC)) != MAGIC:
        return False
    try:
        contents = contents_of(file, end)
        counts = np.zeros(container.NUMBERS, np.int64)
        for part in contents.parts:
            counts += np.bincount(contents.messages(file, part)[1].channel_id, minlength=container.NUMBERS)
        for place in contents.attachments:
            attachment_data(file, place)
    except LogError:
        return False
    file.seek(end.data + RECORD_HEADER)
    wanted = int.from_bytes(file.read(4), "little")
    file.seek(0)
    while block := file.read(min(1 << 20, end.data - file.tell())):
        crc = zlib.crc32(block, crc)
    found = {number: int(counts[number]) for number in np.flatnonzero(counts).tolist()}
    return found == {number: count for number, count in contents.counts.items() if count} and wanted in (0, crc)


class _Copy:
    """What can be read in a file, on its way into a new one."""

    def __init__(self, source: BinaryIO, target: BinaryIO) -> None:
        self._source, self._path = source, Path(source.name)
        self._writer = Writer(target, compression=CompressionType.LZ4)
        end, size = container.end_of(source, any_data_end=True), source.seek(0, 2)
        self._stop, self._left = size if end is None else end.data, container.growth_max(size)
        self._summary = Summary(Contents())
        self._sure: list[int] = []  # where the summary and the record itself say the same
        if end is not None:
            with contextlib.suppress(LogError):
                self._summary = summary_of(source, end)
        for offset, (kind, size, _) in [*self._summary.known.items()]:
            source.seek(offset)
            wanted = bytes([kind]) + max(size - RECORD_HEADER, 0).to_bytes(8, "little")
            wrong = sum(a != b for a, b in zip(source.read(RECORD_HEADER), wanted, strict=False))
            if wrong > 1:  # it says nothing about this file
                del self._summary.known[offset]
            elif not wrong:
                self._sure.append(offset)
        self._contents = self._summary.contents
        self._schemas, self._channels = {0: 0}, dict[int, int]()  # numbers in the new file, by those in the old one
        self._messages = self._last_ns = 0
        self._missing: list[str] = []
        self._lost: list[Section] = []  # what could not be read last, until what it had is known
        self._indexed: dict[int, tuple[int, int, int]] = {}  # its messages by channel: count, first and last log time
        self._files: list[int] | None = None  # where files begin and end that are in this one

    def add_all(self, progress: Callable[[int, int], None]) -> None:
        """Copy what there is. progress: see `recover`."""
        try:
            self._source.seek(len(MAGIC) + RECORD_HEADER)
            header = Header.read(ReadDataStream(self._source))
        except Exception:  # the library raises whatever half a record makes of it
            header = Header("", "")
        self._writer.start(header.profile, header.library)
        known, offset = sorted(self._sure), len(MAGIC)
        while offset < self._stop:
            place = bisect_right(known, offset)
            offset = self._add_at(offset, known[place] if place < len(known) else self._stop)
            progress(min(offset, self._stop), self._stop)
        self._report_lost()
        if not self._messages:
            what = f", and {len(self._missing)} chunks that cannot be read" if self._missing else ""
            raise LogError(f"{self._path} holds nothing to recover: no complete message{what}; nothing was written")

    def _add_at(self, offset: int, following: int) -> int:
        """Copy what stands at a place; return where to go on. following: where the summary names the next record."""
        kind, size, _ = self._summary.known.get(offset, (0, 0, ""))
        try:
            section = section_at(self._source, offset, self._stop)
        except ValueError:
            section = None
        if kind and size and offset + size <= self._stop:
            if section is None or section.opcode != kind or not self._fits(section.end):
                section = Section(kind, offset, size)
            self._add(section)
            return section.end
        if section is None:
            return self._go_on(offset, following)
        if (section.opcode, section.size) == (Opcode.DATA_END, container.DATA_END_SIZE):
            return self._stop
        if section.opcode in LOOSE and not self._fits(section.end):  # the last record's length may be what is wrong
            found = container.walk(container.section_data(self._source, section), self._contents.seen.copy())
            place = max(0, int(found.table.start[-1:].sum()) - MESSAGE.size)
            self._add(Section(section.opcode, offset, place))
            return self._go_on(offset + place, following)
        if section.end > following or not (self._add(section) or self._fits(section.end)):
            return self._go_on(offset, following)
        return section.end

    def _fits(self, offset: int) -> bool:
        """Whether a record may begin at a place: its kind and length are possible."""
        self._source.seek(offset)
        head = self._source.read(RECORD_HEADER)
        return offset >= self._stop or (head[0] > 0 and int.from_bytes(head[1:], "little") <= self._stop - offset)

    def _go_on(self, offset: int, following: int) -> int:
        """Return where records go on behind a damaged one. Of a chunk, copy what can be had."""
        found = self._search(offset + 1, following)
        self._lost = [each for each in self._lost if each.offset != offset]
        lost = Section(Opcode.CHUNK, offset, found - offset)
        if data := rest_of(self._source, lost):
            self._left -= len(data)
            self._copy(data if self._left > 0 else b"", offset)
        else:
            self._lose(Section(0, offset, found - offset))
        return found

    def _search(self, offset: int, stop: int) -> int:
        """Return where records go on, found by what they look like; an attached MCAP file is passed over."""
        with mmap.mmap(self._source.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
            if self._files is None:
                self._files = [each.start() for each in re.finditer(re.escape(MAGIC), mapped)]
            inner = [each for each in self._files if offset <= each < stop][:2]
            data = np.frombuffer(mapped[offset : self._stop], np.uint8)
        found = _plausible(data, (inner[0] if inner else stop) - offset)
        if found >= 0:
            return offset + found
        return self._search(inner[1] + len(MAGIC), stop) if len(inner) == 2 else stop

    def _add(self, section: Section) -> bool:
        """Copy one section; note it where it cannot be read, and return False."""
        try:
            if section.opcode == Opcode.MESSAGE_INDEX:
                self._keep_index(section)
            elif section.opcode == Opcode.CHUNK:
                self._copy(self._chunk(section), section.offset)
            elif section.opcode in LOOSE:
                self._copy(container.section_data(self._source, section), section.offset)
            elif section.opcode == Opcode.METADATA:
                self._contents.limit(Opcode.METADATA, section.size)
                metadata = metadata_at(self._source, section)
                self._writer.add_metadata(metadata.name, metadata.metadata)
            elif section.opcode == Opcode.ATTACHMENT:
                a = attachment_at(self._source, section)
                data = attachment_data(self._source, a)
                self._writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, data)
        except OSError:
            raise
        except Exception:  # the library raises whatever half a record makes of it, and each decompressor its own error
            self._lose(section)
            return False
        return True

    def _chunk(self, section: Section) -> bytes:
        """Return the data of a chunk, by the summary where its own head is damaged."""
        try:
            return self._checked(container.chunk_at(self._source, section))
        except Exception:  # each decompressor has its own
            if (said := self._summary.chunks.get(section.offset)) is None:
                raise
        self._source.seek(section.offset)
        raw = self._source.read(section.size)
        crc = int.from_bytes(raw[_CRC_AT : _CRC_AT + 4], "little")
        data = raw[max(0, len(raw) - said.compressed_size) :]
        return self._checked(Chunk(said.compression, data, 0, 0, crc, said.uncompressed_size))

    def _checked(self, chunk: Chunk) -> bytes:
        self._left -= min(chunk.uncompressed_size, container.LARGEST_CHUNK)
        if self._left < 0:
            raise ValueError("the chunks expand to far more than the file's size")
        crc, chunk.uncompressed_crc = chunk.uncompressed_crc, 0
        data = container.chunk_data(chunk)
        if crc and (crc ^ zlib.crc32(data)).bit_count() > 1:  # one bit: the checksum itself is what is damaged
            raise ValueError("a chunk's checksum is wrong")
        return data

    def _copy(self, data: bytes, offset: int) -> None:
        """Copy the complete messages of a chunk's data."""
        contents, found = self._contents, container.walk(data, self._contents.seen)
        for place in found.definitions:
            with contextlib.suppress(Exception):  # whatever half a record makes of it
                contents.define(data, place)
        table, lost = found.table, 0
        self._left -= len(table.start) * _MESSAGE_BYTES
        if self._left < 0:
            raise ValueError("there are far more messages than the file's size allows")
        for start, size in zip(table.start.tolist(), table.size.tolist(), strict=True):
            _, _, number, sequence, log_ns, publish_ns = MESSAGE.unpack_from(data, start - MESSAGE.size)
            if number not in contents.channels:  # a damaged chunk had its schema, without which it cannot be read
                lost += 1
                continue
            self._writer.add_message(self._channel(number), log_ns, data[start : start + size], publish_ns, sequence)
            self._messages, self._last_ns = self._messages + 1, max(self._last_ns, log_ns)
        if lost:
            self._missing.append(f"{lost} messages of channels that are not defined, at byte {offset}")

    def _channel(self, number: int) -> int:
        """Return the number of a channel in the new file."""
        if number not in self._channels:
            channel = self._contents.channels[number]
            schema = self._contents.schemas.get(channel.schema_id)
            if schema is not None and schema.id not in self._schemas:
                self._schemas[schema.id] = self._writer.register_schema(schema.name, schema.encoding, schema.data)
            schema_id = self._schemas.get(channel.schema_id, 0)
            made = self._writer.register_channel(channel.topic, channel.message_encoding, schema_id, channel.metadata)
            self._channels[number] = made
        return self._channels[number]

    def _keep_index(self, section: Section) -> None:
        """Count what the chunk had that could not be read."""
        if self._lost:
            self._source.seek(section.offset + RECORD_HEADER)
            body = self._source.read(section.size - RECORD_HEADER)
            times = np.frombuffer(body[6 : 6 + (len(body) - 6) // 16 * 16], np.uint64)[::2]
            self._indexed[int.from_bytes(body[:2], "little")] = len(times), int(times.min()), int(times.max())

    def _lose(self, section: Section) -> None:
        self._report_lost()
        self._lost = [section]

    def _report_lost(self) -> None:
        """Say in a line what was lost."""
        for section in self._lost:
            name = self._summary.known.get(section.offset, (0, 0, ""))[2]
            line = f"{_NAMES.get(Opcode(section.opcode), 'records') if section.opcode else 'records'} {name}".strip()
            line += f" at bytes {section.offset} to {section.end}"
            if self._indexed:
                counts, first_ns, last_ns = zip(*self._indexed.values(), strict=True)
                channels = self._contents.channels
                topics = sorted({channels[each].topic for each in self._indexed if each in channels})
                line += f": {sum(counts)} messages of {', '.join(topics) or 'unknown topics'}"
                line += f" from {min(first_ns) * 1e-9:.3f} to {max(last_ns) * 1e-9:.3f} s"
            self._missing.append(line)
        self._lost, self._indexed = [], {}

    def finish(self, output: Path) -> RecoverySummary:
        """Write the metadata record `recovery`, the end of the data, the summary and the footer."""
        for number in self._contents.channels:  # also those without a message
            self._channel(number)
        found = {"source": self._path.name, "damaged_chunks": str(len(self._missing)), "messages": str(self._messages)}
        missing = {"missing": "; ".join(self._missing)} if self._missing else {}
        self._writer.add_metadata("recovery", found | missing)
        self._writer.finish()
        return RecoverySummary(output, False, self._messages, self._last_ns, tuple(self._missing))


@compiled
def _plausible(data, limit):
    """Return where several records in a row begin, before a limit; -1: nowhere."""
    for begin in range(limit):
        place, links = begin, 0
        while links < _CHAIN and place + RECORD_HEADER <= len(data):
            opcode, length = np.int64(data[place]), container.number(data, place + 1, 8)
            if opcode == 0 or opcode >= len(_LEAST) or length < _LEAST[opcode]:
                break
            if length > len(data) - place - RECORD_HEADER:
                break
            place += RECORD_HEADER + length
            links += 1
        if links == _CHAIN or (links > 0 and place == len(data)):
            return begin
    return -1
