"""MCAP record by record, whole or cut off: what the library's readers do not do for a file without an end.

Only complete records are yielded. https://mcap.dev/spec
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from numpy.typing import NDArray

from rtstack.log.errors import LogError

MAGIC = b"\x89MCAP0\r\n"
FOOTER_SIZE = 9 + 20  # record header, two offsets and a checksum
DATA_END_SIZE = 9 + 4  # record header, checksum: what the summary follows
_RECORD = struct.Struct("<BQ")  # opcode, length
MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
LARGEST_CHUNK = 64 << 20  # bytes, uncompressed; our writer's have about 1 MiB
_CHUNK_HEADER = 40  # two times, size, checksum, length of an empty compression name, length of the data
RECORD_HEADER = _RECORD.size
MESSAGE_HEADER = MESSAGE.size


@dataclass(frozen=True, slots=True)
class RawRecord:
    """A top-level record: where it starts in the file, and its content."""

    opcode: int
    offset: int
    body: bytes

    @property
    def size(self) -> int:
        """Bytes in the file, the record's header included."""
        return RECORD_HEADER + len(self.body)

    @property
    def raw(self) -> bytes:
        """The record as the file has it."""
        return bytes([self.opcode]) + len(self.body).to_bytes(8, "little") + self.body

    def stream(self) -> ReadDataStream:
        """Return the content as the library's record classes read it."""
        return ReadDataStream(BytesIO(self.body))


@dataclass(frozen=True, slots=True)
class MessageTable:
    """Where the messages of a chunk are: columns of shape (n,), positions relative to the chunk's data."""

    channel_id: NDArray[np.int64]
    log_time_ns: NDArray[np.int64]
    start: NDArray[np.int64]
    size: NDArray[np.int64]

    def rows(self, chosen: NDArray[np.bool_]) -> "MessageTable":
        """Return the chosen messages."""
        return MessageTable(self.channel_id[chosen], self.log_time_ns[chosen], self.start[chosen], self.size[chosen])


def open_mcap(path: Path) -> BinaryIO:
    """Open a file and check that it starts as an MCAP file does. Raises LogError."""
    try:
        file = open(path, "rb")  # noqa: SIM115 (the caller closes it)
    except OSError as error:
        raise LogError(f"cannot read {path}: {error.strerror}") from error
    if file.read(len(MAGIC)) != MAGIC:
        file.close()
        raise LogError(f"{path} is not an MCAP file")
    return file


def is_complete(file: BinaryIO) -> bool:
    """Whether the file ends with a footer that points to a summary of its own. Moves the file's position.

    One that was cut off behind an attached MCAP ends as that one does.
    """
    size = file.seek(0, 2)
    if size < len(MAGIC) + FOOTER_SIZE + len(MAGIC):
        return False
    file.seek(size - FOOTER_SIZE - len(MAGIC))
    end = file.read()
    opcode, _ = _RECORD.unpack_from(end)
    summary_start = int.from_bytes(end[RECORD_HEADER : RECORD_HEADER + 8], "little")
    if not end.endswith(MAGIC) or opcode != Opcode.FOOTER or not DATA_END_SIZE < summary_start < size:
        return False
    file.seek(summary_start - DATA_END_SIZE)
    return file.read(1) == bytes((Opcode.DATA_END,))


def scan(file: BinaryIO) -> Iterator[RawRecord]:
    """Yield every complete record up to the end of the data section, or to where the file is cut off."""
    size = file.seek(0, 2)
    offset = len(MAGIC)
    while offset + RECORD_HEADER <= size:
        file.seek(offset)
        opcode, length = _RECORD.unpack(file.read(RECORD_HEADER))
        unfinished = opcode == Opcode.CHUNK and length < _CHUNK_HEADER  # some writers fill in the length last
        if opcode == 0 or unfinished or length > size - offset - RECORD_HEADER:
            return
        yield RawRecord(opcode, offset, file.read(length))
        if opcode in (Opcode.DATA_END, Opcode.FOOTER):
            return
        offset += RECORD_HEADER + length


def tail_chunk(file: BinaryIO, offset: int) -> bytes:
    """Return the data that can be had of a chunk record that is cut off by the end of the file, else none."""
    file.seek(offset)
    data = file.read()
    if len(data) < RECORD_HEADER or data[0] != Opcode.CHUNK:
        return b""
    body = ReadDataStream(BytesIO(data[RECORD_HEADER:]))
    try:
        body.read(28)  # two times, size, checksum
        compression = body.read_prefixed_string()
        body.read8()  # length of the data
        compressed = data[RECORD_HEADER + body.count :]
        return _decompressed(compressed, compression, LARGEST_CHUNK)
    except Exception:  # whatever a decoder makes of half a record
        return b""


def _decompressed(data: bytes, compression: str, largest: int) -> bytes:
    """Return at most so many bytes of compressed data, which may be cut off or expand to more than memory holds."""
    if compression == "lz4":
        return lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=largest)
    if compression == "zstd":
        return zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=False).read(largest)
    if compression:
        raise ValueError(f"a chunk's compression is {compression!r}: only lz4 and zstd are known")
    return data


def chunk_data(chunk: Chunk) -> bytes:
    """Return the uncompressed data of a chunk. Raises whatever the decompressor does for a broken one, and ValueError
    for one whose data are not of the size that it says, or of more than LARGEST_CHUNK.
    """
    size = chunk.uncompressed_size
    if size > LARGEST_CHUNK:
        raise ValueError(f"a chunk of {size} bytes: at most {LARGEST_CHUNK} are read")
    data = _decompressed(chunk.data, chunk.compression, size + 1)
    if len(data) != size:
        raise ValueError(f"a chunk says that it has {size} bytes, and has {'more' if len(data) > size else len(data)}")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("a chunk's checksum is wrong")
    return data


def walk(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield (opcode, position, position of the next record) of every complete record in a chunk's data."""
    position, end = 0, len(data)
    while position + RECORD_HEADER <= end:
        opcode, length = _RECORD.unpack_from(data, position)
        following = position + RECORD_HEADER + length
        if following > end:
            return
        yield opcode, position, following
        position = following


def message_table(data: bytes) -> MessageTable:
    """Find the messages in a chunk's data, complete ones only."""
    rows: list[tuple[int, int, int, int]] = []
    for opcode, position, following in walk(data):
        if opcode == Opcode.MESSAGE:
            _, _, channel, _, log_time, _ = MESSAGE.unpack_from(data, position)
            rows.append((channel, log_time, position + MESSAGE_HEADER, following - position - MESSAGE_HEADER))
    columns = np.array(rows, np.int64).reshape(-1, 4).T
    return MessageTable(columns[0], columns[1], columns[2], columns[3])


def definitions(data: bytes) -> tuple[dict[int, Schema], dict[int, Channel]]:
    """Return the schemas and channels that a chunk's data defines, by number."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    for opcode, position, following in walk(data):
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(ReadDataStream(BytesIO(data[position + RECORD_HEADER : following])))
            schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(ReadDataStream(BytesIO(data[position + RECORD_HEADER : following])))
            channels[channel.id] = channel
    return schemas, channels
