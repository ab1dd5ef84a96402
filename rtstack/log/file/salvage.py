"""What can be read of a log that was cut off or damaged: records are looked for behind what is no record."""

import contextlib
import mmap
import re
import zlib
from bisect import bisect_right
from collections.abc import Callable
from typing import Any, BinaryIO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Chunk, Metadata
from numpy.typing import NDArray

from hal.compilation import compiled
from rtstack.log.errors import LogError
from rtstack.log.file import container
from rtstack.log.file.container import LOOSE, MAGIC, MESSAGE_HEADER, RECORD_HEADER, Section, section_at
from rtstack.log.file.contents import Part, Summary, attachment_at, attachment_data, metadata_at, read_summary

_CRC_AT = RECORD_HEADER + 24  # of a chunk: behind two times and its size
_CHAIN = 3  # so many records in a row are no accident
_LEAST = np.array([0, 8, 20, 14, 12, 22, 40, 6, 60, 36, 56, 46, 8, 20, 17, 4])  # bytes of a record, by its opcode
_NAMES = {Opcode.CHUNK: "a chunk", Opcode.METADATA: "metadata", Opcode.ATTACHMENT: "the attachment"}
_MESSAGE_BYTES = 160  # what Python needs for one message


class Salvage:
    """One way through such a file. contents: what was found; missing: a line for each part that cannot be read."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        end, size = container.end_of(file, any_data_end=True), file.seek(0, 2)
        self._stop, self._left = size if end is None else end.data, container.growth_max(size)
        self._summary = Summary()
        if end is not None:
            with contextlib.suppress(LogError):
                self._summary = read_summary(file, end)
        self._sure: list[int] = []  # where the summary and the record itself say the same
        for offset, (kind, size, _) in [*self._summary.known.items()]:
            file.seek(min(offset, self._stop))
            wanted = bytes([kind]) + max(size - RECORD_HEADER, 0).to_bytes(8, "little")
            wrong = sum(a != b for a, b in zip(file.read(RECORD_HEADER), wanted, strict=False))
            if wrong > 1:  # it says nothing about this file
                del self._summary.known[offset]
            elif not wrong:
                self._sure.append(offset)
        self._sure.sort()
        self.contents = self._summary.contents
        self.missing: list[str] = []
        self._lost: Section | None = None  # what could not be read last, until what it had is known
        self._indexed: dict[int, tuple[int, int, int]] = {}  # its messages by channel: count, first and last log time
        self._files: list[int] | None = None  # where files begin and end that are in this one

    def run(self, progress: Callable[[int, int], None] = lambda done, total: None) -> None:
        """Find what there is. progress: called with bytes done and bytes in all."""
        offset = len(MAGIC)
        while offset < self._stop:
            place = bisect_right(self._sure, offset)
            offset = self._add_at(offset, self._sure[place] if place < len(self._sure) else self._stop)
            progress(min(offset, self._stop), self._stop)
        self._report_lost()

    def keep_messages(self, data: bytes, table: NDArray[Any], part: Part) -> None:
        self.contents.add(part, table)

    def keep_metadata(self, metadata: Metadata) -> None:
        self.contents.metadata[metadata.name] = metadata.metadata

    def keep_attachment(self, place: AttachmentIndex, data: bytes) -> None:
        self.contents.attachments.append(place)

    def _add_at(self, offset: int, following: int) -> int:
        """Take what stands at a place; return where to go on. following: where the summary names the next record."""
        kind, size, _ = self._summary.known.get(offset, (0, 0, ""))
        section = None
        with contextlib.suppress(ValueError):
            section = section_at(self._file, offset, self._stop)
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
            table = container.walk(container.section_data(self._file, section), self.contents.seen.copy())[0]
            place = max(0, int(table["start"][-1:].sum()) - MESSAGE_HEADER)
            self._add(Section(section.opcode, offset, place))
            return self._go_on(offset + place, following)
        if section.end > following or not (self._add(section) or self._fits(section.end)):
            return self._go_on(offset, following)
        return section.end

    def _fits(self, offset: int) -> bool:
        """Whether a record may begin at a place: its kind and length are possible."""
        self._file.seek(offset)
        head = self._file.read(RECORD_HEADER)
        return offset >= self._stop or (head[0] > 0 and int.from_bytes(head[1:], "little") <= self._stop - offset)

    def _go_on(self, offset: int, following: int) -> int:
        """Return where records go on behind a damaged one. Of a chunk, take what can be had."""
        found = self._search(offset + 1, following)
        if self._lost is not None and self._lost.offset == offset:
            self._lost = None
        lost = Section(Opcode.CHUNK, offset, found - offset)
        if data := rest_of(self._file, lost):
            self._left -= len(data)
            self._take(data if self._left > 0 else b"", Part(lost, rest=data))
        else:
            self._lose(Section(0, offset, found - offset))
        return found

    def _search(self, offset: int, stop: int) -> int:
        """Return where records go on, found by what they look like; an attached MCAP file is passed over."""
        with mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
            if self._files is None:
                self._files = [each.start() for each in re.finditer(re.escape(MAGIC), mapped)]
            inner = [each for each in self._files if offset <= each < stop][:2]
            data = np.frombuffer(mapped[offset : self._stop], np.uint8)
        found = _plausible(data, (inner[0] if inner else stop) - offset)
        if found >= 0:
            return offset + found
        return self._search(inner[1] + len(MAGIC), stop) if len(inner) == 2 else stop

    def _add(self, section: Section) -> bool:
        """Take one section; note it where it cannot be read, and return False."""
        try:
            if section.opcode == Opcode.MESSAGE_INDEX:
                self._keep_index(section)
            elif section.opcode == Opcode.CHUNK:
                self._take(*self._chunk(section))
            elif section.opcode in LOOSE:
                self._take(container.section_data(self._file, section), Part(section))
            elif section.opcode == Opcode.METADATA:
                self.contents.limit(Opcode.METADATA, section.size)
                self.keep_metadata(metadata_at(self._file, section))
            elif section.opcode == Opcode.ATTACHMENT:
                place = attachment_at(self._file, section)
                self.keep_attachment(place, attachment_data(self._file, place))
        except OSError:
            raise
        except Exception:  # the library raises whatever half a record makes of it, and each decompressor its own error
            self._lose(section)
            return False
        return True

    def _chunk(self, section: Section) -> tuple[bytes, Part]:
        """Return the data of a chunk, by the summary where its own head is damaged, else whatever length it says."""
        with contextlib.suppress(Exception):  # each decompressor has its own
            return self._checked(container.chunk_at(self._file, section), section)
        said = self._summary.chunks.get(section.offset)
        self._file.seek(section.offset)
        raw = self._file.read(min(section.size, 2 * container.LARGEST_CHUNK))
        if said is None:
            chunk = container.chunk_at(self._file, section, cut=True)
            chunk.data = raw[container.CHUNK.size + len(chunk.compression) + 8 :]
        else:
            crc = int.from_bytes(raw[_CRC_AT : _CRC_AT + 4], "little")
            data = raw[max(0, len(raw) - said.compressed_size) :]
            chunk = Chunk(said.compression, data, 0, 0, crc, said.uncompressed_size)
        data, part = self._checked(chunk, section)
        return data, Part(section, rest=part.rest or data)

    def _checked(self, chunk: Chunk, section: Section) -> tuple[bytes, Part]:
        self._left -= min(chunk.uncompressed_size, container.LARGEST_CHUNK)
        if self._left < 0:
            raise ValueError("the chunks expand to far more than the file's size")
        crc, chunk.uncompressed_crc = chunk.uncompressed_crc, 0
        data = container.chunk_data(chunk)
        wrong = crc ^ zlib.crc32(data) if crc else 0
        if wrong.bit_count() > 1:  # one bit: the checksum itself is what is damaged
            raise ValueError("a chunk's checksum is wrong")
        return data, Part(section, rest=data if wrong else None)

    def _take(self, data: bytes, part: Part) -> None:
        """Take the complete messages of a part whose channels are known."""
        table, definitions, conflicts, end = container.walk(data, self.contents.seen)
        for place in definitions:
            with contextlib.suppress(Exception):  # whatever half a record makes of it
                self.contents.define(data, place)
        self._left -= len(table) * _MESSAGE_BYTES
        if self._left < 0:
            raise ValueError("there are far more messages than the file's size allows")
        known = np.isin(table["channel"], [*self.contents.channels])  # of others a damaged chunk had the schema
        if conflicts or end != len(data):
            part.rest = data
        self.keep_messages(data, table[known], part)
        if lost := len(table) - np.count_nonzero(known):
            self.missing.append(f"{lost} messages of channels that are not defined, at byte {part.section.offset}")

    def _keep_index(self, section: Section) -> None:
        """Count what the chunk had that could not be read."""
        if self._lost:
            self._file.seek(section.offset + RECORD_HEADER)
            body = self._file.read(section.size - RECORD_HEADER)
            times = np.frombuffer(body[6 : 6 + (len(body) - 6) // 16 * 16], np.uint64)[::2]
            self._indexed[int.from_bytes(body[:2], "little")] = len(times), int(times.min()), int(times.max())

    def _lose(self, section: Section) -> None:
        self._report_lost()
        self._lost = section

    def _report_lost(self) -> None:
        if (section := self._lost) is not None:
            name = self._summary.known.get(section.offset, (0, 0, ""))[2]
            line = f"{_NAMES.get(Opcode(section.opcode), 'records') if section.opcode else 'records'} {name}".strip()
            line += f" at bytes {section.offset} to {section.end}"
            if self._indexed:
                counts, first_ns, last_ns = zip(*self._indexed.values(), strict=True)
                channels = self.contents.channels
                topics = sorted({channels[each].topic for each in self._indexed if each in channels})
                line += f": {sum(counts)} messages of {', '.join(topics) or 'unknown topics'}"
                line += f" from {min(first_ns) * 1e-9:.3f} to {max(last_ns) * 1e-9:.3f} s"
            self.missing.append(line)
        self._lost, self._indexed = None, {}


def rest_of(file: BinaryIO, section: Section) -> bytes:
    """Return the data that can be had of a chunk that is cut off, or whose length is wrong, else none."""
    file.seek(section.offset)
    if file.read(1) != bytes([Opcode.CHUNK]):
        return b""
    try:
        chunk = container.chunk_at(file, section, cut=True)
        data = container.decompressed(chunk.data, chunk.compression)
    except Exception:  # whatever a decoder makes of half a record
        return b""
    whole = len(data) >= chunk.uncompressed_size
    return b"" if whole and chunk.uncompressed_crc not in (0, zlib.crc32(data)) else data


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
