"""A chunk that expands to more than it says, or than memory holds, is refused before it is there."""

import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.records import Chunk

from rtstack.log.file.container import LARGEST_CHUNK, MAGIC, Section, chunk_data
from rtstack.log.file.salvage import rest_of

BLOCK = bytes(1 << 20)
BOMB_BLOCKS = 1024  # 1 GiB
GROWTH_MAX = 4 * LARGEST_CHUNK  # lz4 doubles what it has room for


def _lz4(blocks: int) -> Iterator[bytes]:
    compressor = lz4.frame.LZ4FrameCompressor()
    yield compressor.begin()
    for _ in range(blocks):
        yield compressor.compress(BLOCK)
    yield compressor.flush()


def _zstd(blocks: int) -> Iterator[bytes]:
    compressor = zstandard.ZstdCompressor().compressobj()
    for _ in range(blocks):
        yield compressor.compress(BLOCK)
    yield compressor.flush()


def _sized_zstd(blocks: int) -> Iterator[bytes]:
    """The frame's own header says how much it is, which some decompressors allocate at once."""
    compressor = zstandard.ZstdCompressor().compressobj(size=blocks * len(BLOCK))
    for _ in range(blocks):
        yield compressor.compress(BLOCK)
    yield compressor.flush()


WRITERS = {"lz4": _lz4, "zstd": _zstd, "sized zstd": _sized_zstd}


def _chunk(kind: str, data: bytes, size: int, crc: int = 0) -> Chunk:
    return Chunk(
        compression=kind.split()[-1], data=data, message_start_time=0, message_end_time=0, uncompressed_crc=crc,
        uncompressed_size=size,
    )  # fmt: skip


def _peak(anew: bool = False) -> int:
    """The most memory that this process has had in bytes, from the last time on that it was begun anew."""
    if anew:
        Path("/proc/self/clear_refs").write_text("5")  # proc(5)
    (line,) = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM:")]
    return int(line.split()[1]) * 1024


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("size", [1000, LARGEST_CHUNK])
def test_a_chunk_that_expands_to_more_than_it_says_is_refused(kind: str, size: int) -> None:
    data, before = b"".join(WRITERS[kind](BOMB_BLOCKS)), _peak(anew=True)
    with pytest.raises(ValueError, match="has more"):
        chunk_data(_chunk(kind, data, size))
    assert _peak() - before < GROWTH_MAX


@pytest.mark.parametrize("size", [LARGEST_CHUNK + 1, 1 << 62])
def test_a_chunk_that_says_it_is_too_large_is_refused(size: int) -> None:
    with pytest.raises(ValueError, match="at most"):
        chunk_data(_chunk("lz4", b"".join(_lz4(1)), size))


@pytest.mark.parametrize("kind", WRITERS)
def test_the_tail_of_a_file_expands_to_no_more_than_a_chunk(kind: str) -> None:
    data = b"".join(WRITERS[kind](BOMB_BLOCKS))
    name = kind.split()[-1].encode()
    body = bytes(28) + len(name).to_bytes(4, "little") + name + len(data).to_bytes(8, "little") + data
    file, before = BytesIO(MAGIC + bytes([Opcode.CHUNK]) + len(body).to_bytes(8, "little") + body), _peak(anew=True)
    assert len(rest_of(file, Section(Opcode.CHUNK, len(MAGIC), file.seek(0, 2) - len(MAGIC)))) <= LARGEST_CHUNK
    assert _peak() - before < GROWTH_MAX


@pytest.mark.parametrize(
    "change",
    [
        lambda data: (data, len(BLOCK) + 1, 0),
        lambda data: (data[:-100], len(BLOCK), 0),
        lambda data: (data, len(BLOCK), zlib.crc32(BLOCK) ^ 1),
    ],
    ids=["shorter than it says", "cut off", "wrong checksum"],
)
@pytest.mark.parametrize("kind", WRITERS)
def test_a_damaged_chunk_is_refused(kind: str, change: Callable[[bytes], tuple[bytes, int, int]]) -> None:
    data = b"".join(WRITERS[kind](1))
    assert chunk_data(_chunk(kind, data, len(BLOCK), zlib.crc32(BLOCK))) == BLOCK
    with pytest.raises((ValueError, RuntimeError, zstandard.ZstdError)):
        chunk_data(_chunk(kind, *change(data)))


def test_an_unknown_compression_is_named() -> None:
    with pytest.raises(ValueError, match="'snappy'"):
        chunk_data(_chunk("snappy", b"", 0))
