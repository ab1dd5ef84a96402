"""MCAP record by record, whole or cut off: what the library's readers do not do for a file without an end.

https://mcap.dev/spec
"""

import contextlib
import os
import stat
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.records import Chunk
from numpy.typing import NDArray

from hal.compilation import compiled
from rtstack.log.errors import LogError, damaged, remedy

MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")  # opcode, length
MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
CHUNK = struct.Struct("<BQQQQII")  # opcode, length, log times, size, checksum, length of the compression's name
RECORD_HEADER = _RECORD.size
MESSAGE_HEADER = MESSAGE.size
FOOTER_SIZE = RECORD_HEADER + 20  # two offsets and a checksum
DATA_END_SIZE = RECORD_HEADER + 4  # checksum: what the summary follows
_CHUNK_MIN = CHUNK.size - RECORD_HEADER + 8  # of an empty one; some writers fill in the length last
LARGEST_CHUNK = 64 << 20  # bytes, uncompressed; our writer's have about 1 MiB
_LONGEST_NAME = 64  # bytes, of a compression
_BLOCK = 4 << 20  # bytes of a run of records outside of chunks
NUMBERS = 1 << 16  # schemas, and channels, that there can be
LOOSE = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)  # may stand outside of chunks
_SUMMARY = (
    Opcode.FOOTER, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.STATISTICS, Opcode.METADATA_INDEX,
    Opcode.SUMMARY_OFFSET,
)  # fmt: skip
# where messages are in a chunk's data
MESSAGES = np.dtype([("channel", np.int64), ("log_time_ns", np.uint64), ("start", np.int64), ("size", np.int64)])
_ALLOWANCE, _GROWTH = 256 << 20, 64  # bytes, and times the file's size, that a file may expand to


class Unreadable(ValueError):
    """What a file may have, and this reader does not read."""


@dataclass(frozen=True, slots=True)
class Section:
    """A record outside of chunks, or a run of schemas, channels and messages there (its first one's opcode)."""

    opcode: int
    offset: int
    size: int

    @property
    def end(self) -> int:
        return self.offset + self.size


@dataclass(frozen=True, slots=True)
class End:
    """Where a finished file's data section and its summary end; the summary begins behind the record DATA_END."""

    data: int
    footer: int
    summary_crc: int

    @property
    def summary(self) -> int:
        return self.data + DATA_END_SIZE


def open_mcap(path: Path, any_start: bool = False) -> BinaryIO:
    """Open a file and check that it starts as an MCAP file does, or ends so (any_start). Raises LogError at once."""
    try:
        # a pipe or a device is not waited for
        file = open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK))  # noqa: SIM115
        status = os.fstat(file.fileno())
    except (OSError, ValueError) as error:  # a zero byte in the name
        special = os.path.lexists(path) and not os.path.isfile(path)  # a socket
        reason = "it is not a regular file" if special else getattr(error, "strerror", None) or error
        raise LogError(f"cannot read {path}: {reason}") from error
    reason, size = "", status.st_size
    if not stat.S_ISREG(status.st_mode):
        reason = f"cannot read {path}: it is not a regular file"
    elif not size:
        reason = f"{path} is empty: nothing to recover"
    elif file.read(len(MAGIC)) != MAGIC:
        file.seek(max(0, size - len(MAGIC)))
        ends = file.read() == MAGIC
        if not (ends and any_start):
            reason = f"{path} is damaged at byte 0: {remedy(path)}" if ends else f"{path} is not an MCAP file"
    if reason:
        file.close()
        raise LogError(reason)
    return file


def end_of(file: BinaryIO, any_data_end: bool = False) -> End | None:
    """Return where the data section and the summary of a finished file end, None of one that was cut off, also behind
    an attached MCAP, whose footer points elsewhere.

    any_data_end: the record between them may be damaged, where the summary has a checksum that fits.
    """
    footer = file.seek(0, 2) - FOOTER_SIZE - len(MAGIC)
    if footer < len(MAGIC) + DATA_END_SIZE:
        return None
    file.seek(footer)
    opcode, length, summary, _, crc, magic = struct.unpack("<BQQQI8s", file.read())
    data = (summary or footer) - DATA_END_SIZE
    if (opcode, length, magic) != (Opcode.FOOTER, 20, MAGIC) or not len(MAGIC) <= data <= footer - DATA_END_SIZE:
        return None
    file.seek(data)
    fits = file.read(RECORD_HEADER) == _RECORD.pack(Opcode.DATA_END, 4)
    if any_data_end and not fits and summary:
        file.seek(summary)
        fits = crc == zlib.crc32(file.read(footer + FOOTER_SIZE - 4 - summary))
    return End(data, footer, crc) if fits else None


def is_complete(file: BinaryIO) -> bool:
    """Whether the file ends as a finished one does. Moves the file's position."""
    return end_of(file) is not None


def section_at(file: BinaryIO, offset: int, stop: int) -> Section:
    """Return what stands at a place of the data section, which ends before `stop`. Raises ValueError for no record."""
    file.seek(offset)
    head = file.read(min(RECORD_HEADER, stop - offset))
    if len(head) < RECORD_HEADER:
        raise ValueError("a record is cut off")
    opcode, length = _RECORD.unpack(head)
    if opcode == 0 or opcode in _SUMMARY or (opcode == Opcode.HEADER and offset != len(MAGIC)):
        raise ValueError(f"a record of kind {opcode} has no place here")
    if length > stop - offset - RECORD_HEADER:
        raise ValueError(f"a record has {length} bytes, and {stop - offset - RECORD_HEADER} are left")
    if opcode == Opcode.CHUNK and length < _CHUNK_MIN:
        raise ValueError(f"a chunk has {length} bytes")
    size = RECORD_HEADER + length
    if opcode in LOOSE:
        file.seek(offset)
        size = max(size, _run(np.frombuffer(file.read(min(_BLOCK, stop - offset)), np.uint8)))
    return Section(opcode, offset, size)


def sections(file: BinaryIO) -> Iterator[Section]:
    """Yield what a file has one after another, up to where it is cut off or damaged."""
    offset, stop = len(MAGIC), file.seek(0, 2)
    with contextlib.suppress(ValueError):
        while offset < stop:
            section = section_at(file, offset, stop)
            yield section
            offset = section.end


def chunk_at(file: BinaryIO, section: Section, head: bool = False, cut: bool = False) -> Chunk:
    """Return a chunk; `head`: without its data; `cut`: whatever its length, with the data that are there.

    Raises ValueError for a chunk that does not fit, struct.error for half a head.
    """
    if section.size > 2 * LARGEST_CHUNK and not cut:
        raise Unreadable(f"a chunk has {section.size} bytes: at most {LARGEST_CHUNK} are read")
    file.seek(section.offset)
    raw = file.read(min(section.size, CHUNK.size + _LONGEST_NAME + 8 if head else 2 * LARGEST_CHUNK))
    _, _, first_ns, last_ns, size, crc, named = CHUNK.unpack_from(raw)
    place = CHUNK.size + named + 8
    if named > _LONGEST_NAME or place > section.size:
        raise ValueError(f"the name of a chunk's compression has {named} bytes")
    stored = int.from_bytes(raw[place - 8 : place], "little")
    if stored > section.size - place and not cut:
        raise ValueError(f"a chunk says that it has {stored} bytes, and has {section.size - place}")
    return Chunk(
        compression=raw[CHUNK.size : place - 8].decode(), data=raw[place : place + stored], uncompressed_size=size,
        uncompressed_crc=crc, message_start_time=first_ns, message_end_time=last_ns,
    )  # fmt: skip


def decompressed(data: bytes, compression: str, largest: int = LARGEST_CHUNK) -> bytes:
    """Return at most so many bytes of compressed data, which may be cut off or expand to more than memory holds."""
    if compression == "lz4":
        return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=largest)
    if compression == "zstd":
        return zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True).read(largest)
    if compression:
        raise Unreadable(f"a chunk's compression is {compression!r}: only lz4 and zstd are known")
    return data


def chunk_data(chunk: Chunk) -> bytes:
    """Return the uncompressed data of a chunk. Raises whatever the decompressor does for a broken one, and ValueError
    for one whose data are not of the size that it says, or of more than LARGEST_CHUNK."""
    size = chunk.uncompressed_size
    if size > LARGEST_CHUNK:
        raise Unreadable(f"a chunk of {size} bytes: at most {LARGEST_CHUNK} are read")
    data = decompressed(chunk.data, chunk.compression, size + 1)
    if len(data) != size:
        raise ValueError(f"a chunk says that it has {size} bytes, and has {'more' if len(data) > size else len(data)}")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("a chunk's checksum is wrong")
    return data


def section_data(file: BinaryIO, section: Section) -> bytes:
    """Return the schemas, channels and messages of a chunk or of a run outside of chunks. Raises LogError."""
    try:
        if section.opcode == Opcode.CHUNK:
            return chunk_data(chunk_at(file, section))
        if section.size > LARGEST_CHUNK:
            raise Unreadable(f"a record has {section.size} bytes: at most {LARGEST_CHUNK} are read")
    except Unreadable as error:
        cause = f"cannot be read at byte {section.offset}: {error}"
        raise LogError(f"{file.name} {cause}; if it was damaged, {remedy(Path(file.name))}") from error
    except Exception as error:  # each decompressor has its own
        raise damaged(Path(file.name), section.offset, error) from error
    file.seek(section.offset)
    return file.read(section.size)


def growth_max(file_size: int) -> int:
    """Return how many bytes a file of this size may expand to: the measured logs expand to 2 to 10 times their size."""
    return _ALLOWANCE + _GROWTH * file_size


def walk(data: bytes, seen: NDArray[np.int64]) -> tuple[NDArray[Any], list[int], list[int], int]:
    """Return the complete messages in a chunk's data, as MESSAGES; the places of new schemas and channels, and of those
    that differ from an earlier one of the same number; and where the last complete record ends.

    seen: checksums of the schemas and channels so far, (2 * NUMBERS,), to which those in the data are added.
    """
    rows = np.empty((len(data) // MESSAGE_HEADER + 1, 4), np.int64)
    places = np.empty(min(len(data) // RECORD_HEADER, 2 * NUMBERS) + 1, np.int64)
    messages, defined, end = _walk(np.frombuffer(data, np.uint8), seen, rows, places)
    new = places[:defined].tolist()
    table = rows[:messages].view(MESSAGES)[:, 0]
    return table, [place for place in new if place >= 0], [~place for place in new if place < 0], int(end)


@compiled
def _walk(data, seen, rows, places):
    place, messages, defined = 0, 0, 0
    while place + RECORD_HEADER <= len(data):
        opcode, length = np.int64(data[place]), number(data, place + 1, 8)
        body = place + RECORD_HEADER
        if opcode == 0 or length < 0 or length > len(data) - body:
            break
        if opcode == 5:  # Opcode.MESSAGE
            if length < MESSAGE_HEADER - RECORD_HEADER:
                break
            rows[messages, 0], rows[messages, 1] = number(data, body, 2), number(data, body + 6, 8)
            rows[messages, 2] = place + MESSAGE_HEADER
            rows[messages, 3] = length - (MESSAGE_HEADER - RECORD_HEADER)
            messages += 1
        elif opcode in (3, 4):  # Opcode.SCHEMA, Opcode.CHANNEL
            if length < 2 or defined == len(places):
                break
            checksum = 2166136261  # FNV-1a, 32 bit
            for k in range(body, body + length):
                checksum = ((checksum ^ data[k]) * 16777619) & 0xFFFFFFFF
            key = (opcode - 3) * NUMBERS + number(data, body, 2)
            if seen[key] != checksum + 1:
                places[defined] = place if seen[key] == 0 else ~place
                defined += 1
            if seen[key] == 0:
                seen[key] = checksum + 1
        place = body + length
    return messages, defined, place


@compiled
def _run(data):
    """Return how many bytes of complete schemas, channels and messages the data begin with."""
    place = 0
    while place + RECORD_HEADER <= len(data) and data[place] in (3, 4, 5):
        length = number(data, place + 1, 8)
        if length < 0 or length > len(data) - place - RECORD_HEADER:
            break
        place += RECORD_HEADER + length
    return place


@compiled
def number(data, place, size):
    value = 0
    for k in range(size):
        value |= np.int64(data[place + k]) << (8 * k)
    return value
