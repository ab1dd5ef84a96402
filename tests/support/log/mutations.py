"""Small logs, and what can be done to their structure: records dropped, repeated, moved, resized; fields changed."""

import random
import struct
import zlib
from collections import Counter
from collections.abc import Callable
from io import BytesIO
from typing import Any

import lz4.frame
import zstandard
from google.protobuf import descriptor_pb2
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Footer, McapRecord, MessageIndex, MetadataIndex, Statistics
from mcap.writer import CompressionType, IndexType, Writer

MAGIC = b"\x89MCAP0\r\n"
Record = tuple[int, bytes]  # opcode, content
Times = dict[str, list[int]]  # log times of each topic, in order
NUMBERS = (0, 1, 2, 7, 22, 255, 256, 65535, 1 << 31, (1 << 32) - 1, 1 << 40, (1 << 63) - 1, 1 << 63, (1 << 64) - 1)
# sizes of the numbers that a record begins with, or that stand before its end
HEADS: dict[int, tuple[int, ...]] = {
    Opcode.HEADER: (4,), Opcode.FOOTER: (8, 8, 4), Opcode.SCHEMA: (2, 4), Opcode.CHANNEL: (2, 2, 4),
    Opcode.MESSAGE: (2, 4, 8, 8), Opcode.CHUNK: (8, 8, 8, 4, 4), Opcode.MESSAGE_INDEX: (2, 4, 8, 8),
    Opcode.CHUNK_INDEX: (8, 8, 8, 8, 4, 2, 8, 2, 8), Opcode.ATTACHMENT: (8, 8, 4), Opcode.ATTACHMENT_INDEX: (8,) * 5,
    Opcode.STATISTICS: (8, 2, 4, 4, 4, 4, 8, 8, 4, 2, 8, 2, 8), Opcode.METADATA: (4,), Opcode.METADATA_INDEX: (8, 8, 4),
    Opcode.SUMMARY_OFFSET: (1, 8, 8), Opcode.DATA_END: (4,),
}  # fmt: skip
SUMMARY = (Opcode.CHUNK_INDEX, Opcode.STATISTICS, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET)


def small_schema() -> bytes:
    """Return a description of rtstack.ArmSample as an older version might have it: with two fields."""
    fields = [("q", 1, 1, 3), ("robot_mode", 2, 3, 1)]  # name, number, double or int64, repeated or optional
    message = descriptor_pb2.DescriptorProto(name="ArmSample")
    for name, number, kind, label in fields:
        message.field.add(name=name, number=number, type=kind, label=label)  # pyright: ignore[reportArgumentType]
    file = descriptor_pb2.FileDescriptorProto(name="small.proto", package="rtstack", syntax="proto3")
    file.message_type.append(message)
    return descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()


def small_log(rng: random.Random, **options: Any) -> bytes:
    """Return a log of some messages of both arms and of a foreign topic; options: of the library's writer."""
    file = BytesIO()
    writer = Writer(file, **options)
    writer.start("", "small")
    writer.add_metadata("trial", {"kind": "trial", "seed": "7"})
    writer.add_attachment(0, 0, "cell.toml", "application/toml", b"name = 'grab'\n")
    ours = writer.register_schema("rtstack.ArmSample", "protobuf", small_schema())
    other = writer.register_schema("x", "jsonschema", b"{}")
    channels = [writer.register_channel(f"/{side}/arm", "protobuf", ours) for side in ("left", "right")]
    channels += [writer.register_channel("/left/arm", "protobuf", ours)] * (rng.random() < 0.2)
    foreign = writer.register_channel("/other", "json", other)
    for t_ns in range(1, rng.randrange(3, 16)):
        for channel in channels:
            q = struct.pack("<7d", *(rng.random() for _ in range(7)))
            writer.add_message(channel, t_ns * 1_000_000, b"\x0a\x38" + q + b"\x10" + bytes([1 + t_ns % 5]), t_ns)
        if rng.random() < 0.2:
            writer.add_message(foreign, rng.choice((t_ns * 1_000_000, 1 << 60)), b"{}", t_ns)
    writer.add_metadata("result", {"success": "true"})
    writer.finish()
    return file.getvalue()


def options(rng: random.Random) -> dict[str, Any]:
    """Return options of the library's writer."""
    kinds = (IndexType.ALL, IndexType.ALL, IndexType.NONE, IndexType.CHUNK, IndexType.MESSAGE | IndexType.CHUNK)
    return {
        "chunk_size": rng.choice((300, 1500, 100_000)), "compression": rng.choice(list(CompressionType)),
        "index_types": rng.choice(kinds), "use_chunking": rng.random() < 0.85, "enable_crcs": rng.random() < 0.8,
        "enable_data_crcs": rng.random() < 0.3, "use_summary_offsets": rng.random() < 0.7,
        **{name: rng.random() < 0.8 for name in ("repeat_channels", "repeat_schemas", "use_statistics")},
    }  # fmt: skip


def split(data: bytes, place: int = 0) -> list[Record]:
    """Return the records of some bytes, complete ones only. Raises ValueError for bytes behind the last one."""
    records = []
    while place + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, place)
        if opcode == 0 or place + 9 + length > len(data):
            break
        records.append((opcode, data[place + 9 : place + 9 + length]))
        place += 9 + length
    if place != len(data):
        raise ValueError(f"{len(data) - place} bytes are no record")
    return records


def join(records: list[Record]) -> bytes:
    """Return records as bytes."""
    return b"".join(bytes([opcode]) + len(body).to_bytes(8, "little") + body for opcode, body in records)


def whole(records: list[Record]) -> bytes:
    """Return a file of records."""
    return MAGIC + join(records) + MAGIC


def messages_of(data: bytes, streamed: bool = False, defined: bool = False) -> Times | None:
    """Return the log times that an independent walk of a file finds, None where anything in it is not whole.

    streamed: nor where a message stands before its channel, or its channel in the summary alone. defined: without
    messages of channels that are not defined, which else are not whole.
    """
    try:
        if not data.startswith(MAGIC) or not data.endswith(MAGIC):
            return None
        records = split(data[len(MAGIC) : -len(MAGIC)])
        end = [opcode for opcode, _ in records].index(Opcode.DATA_END)
        if records[-1][0] != Opcode.FOOTER:
            return None
        topics: dict[int, bytes] = {}
        schemas: dict[int, bytes] = {}
        found: list[tuple[int, int]] = []
        for opcode, body in records[:end]:
            for kind, content in [(opcode, body)] if opcode != Opcode.CHUNK else split(opened(body)):
                if kind in (Opcode.CHANNEL, Opcode.SCHEMA):
                    known = topics if kind == Opcode.CHANNEL else schemas
                    (number,) = struct.unpack_from("<H", content)
                    if known.setdefault(number, content) != content:
                        return None
                elif kind == Opcode.MESSAGE:
                    number, _, log_ns, _ = struct.unpack_from("<HIQQ", content)
                    if streamed and number not in topics:
                        return None
                    found.append((number, log_ns))
        for kind, content in records[end:]:  # a channel that the summary alone has is good enough
            if kind == Opcode.CHANNEL:
                topics.setdefault(int.from_bytes(content[:2], "little"), content)
        names = {number: Channel.read(ReadDataStream(BytesIO(body))).topic for number, body in topics.items()}
        times: Times = {}
        for number, log_ns in found:
            if defined and number not in names:
                continue
            times.setdefault(names[number], []).append(log_ns)
        return {name: sorted(each) for name, each in times.items()}
    except Exception:  # whatever each library makes of it
        return None


def contradicted(data: bytes) -> bool:
    """Whether the statistics of a file that is whole count other messages of a channel than there are."""
    said: dict[int, int] = {}
    found: Counter[int] = Counter()
    for opcode, body in split(data[len(MAGIC) : -len(MAGIC)]):
        for kind, content in [(opcode, body)] if opcode != Opcode.CHUNK else split(opened(body)):
            if kind == Opcode.MESSAGE:
                found[int.from_bytes(content[:2], "little")] += 1
            elif kind == Opcode.STATISTICS:
                said = Statistics.read(ReadDataStream(BytesIO(content))).channel_message_counts
    return Counter(said) != found


def opened(body: bytes) -> bytes:
    """Return the data of a chunk. Raises whatever the libraries do for a broken one."""
    chunk = Chunk.read(ReadDataStream(BytesIO(body)))
    unpack: dict[str, Callable[[bytes], bytes]] = {"": bytes}  # a frame may lack its last byte: nothing is lost
    unpack["lz4"] = lambda packed: lz4.frame.LZ4FrameDecompressor().decompress(packed)
    unpack["zstd"] = lambda packed: zstandard.ZstdDecompressor().decompressobj().decompress(packed)
    data = unpack[chunk.compression](chunk.data)
    if len(data) != chunk.uncompressed_size or chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("not whole")
    return data


def packed(data: bytes, compression: str, head: bytes) -> bytes:
    """Return a chunk's content; its times as another one has them."""
    pack = {"lz4": lz4.frame.compress, "zstd": zstandard.compress}.get(compression, bytes)(data)
    name = compression.encode()
    return (
        head[:16] + len(data).to_bytes(8, "little") + zlib.crc32(data).to_bytes(4, "little")
        + len(name).to_bytes(4, "little") + name + len(pack).to_bytes(8, "little") + pack
    )  # fmt: skip


def _written(record: McapRecord) -> Record:
    builder = RecordBuilder()
    record.write(builder)
    data = builder.end()
    return data[0], data[9:]


def indexed(records: list[Record]) -> list[Record]:
    """Return records with a summary that fits them."""
    kept: list[Record] = []
    summary: list[Record] = []
    counts: dict[int, int] = {}
    defined: dict[tuple[int, int], Record] = {}
    place, kinds = len(MAGIC), {Opcode.ATTACHMENT: 0, Opcode.CHUNK: 0, Opcode.METADATA: 0}
    for opcode, body in records:
        if opcode == Opcode.DATA_END:
            break
        if opcode == Opcode.MESSAGE_INDEX:
            continue
        size = 9 + len(body)
        inner = [(opcode, body)]
        if opcode == Opcode.CHUNK:
            inner = split(opened(body))
            chunk = Chunk.read(ReadDataStream(BytesIO(body)))
            summary.append(_written(ChunkIndex(
                size, place, chunk.compression, len(chunk.data), chunk.message_end_time, 0, {},
                chunk.message_start_time, chunk.uncompressed_size,
            )))  # fmt: skip
        elif opcode == Opcode.METADATA:
            summary.append(_written(MetadataIndex(place, size, "x")))
        for kind, content in inner:
            number = int.from_bytes(content[:2], "little")
            if kind == Opcode.MESSAGE:
                counts[number] = counts.get(number, 0) + 1
            elif kind in (Opcode.SCHEMA, Opcode.CHANNEL):
                defined[kind, number] = kind, content
        if opcode in kinds:
            kinds[Opcode(opcode)] += 1
        kept.append((opcode, body))
        place += size
    numbers = [kind for kind, _ in defined]
    summary += [*defined.values(), _written(Statistics(
        attachment_count=kinds[Opcode.ATTACHMENT], channel_count=numbers.count(Opcode.CHANNEL),
        channel_message_counts=counts, chunk_count=kinds[Opcode.CHUNK], message_count=sum(counts.values()),
        message_start_time=0, message_end_time=0, metadata_count=kinds[Opcode.METADATA],
        schema_count=numbers.count(Opcode.SCHEMA),
    ))]  # fmt: skip
    return [*kept, (Opcode.DATA_END, bytes(4)), *summary, _written(Footer(place + 13, 0, 0))]


def end_fitted(records: list[Record]) -> list[Record]:
    """Return records with a footer that points to the summary, without checksums."""
    kinds = [opcode for opcode, _ in records]
    if Opcode.DATA_END not in kinds:
        return records
    end = kinds.index(Opcode.DATA_END)
    start = len(MAGIC) + len(join(records[: end + 1]))
    empty = records[end + 1][0] == Opcode.FOOTER if end + 1 < len(records) else True
    footer = _written(Footer(0 if empty else start, 0, 0))
    return [*records[:end], (Opcode.DATA_END, bytes(4)), *[r for r in records[end + 1 :] if r[0] != 2], footer]


def changed(rng: random.Random, record: Record) -> Record:
    """Return a record with one of its numbers changed."""
    opcode, body = record
    sizes = HEADS.get(opcode, (8,))
    k = rng.randrange(len(sizes))
    place, size = sum(sizes[:k]), sizes[k]
    if place + size > len(body):
        return record
    old = int.from_bytes(body[place : place + size], "little")
    new = rng.choice((*NUMBERS, old + 1, old - 1, old * 2, old ^ (1 << rng.randrange(8 * size)))) % (1 << (8 * size))
    return opcode, body[:place] + new.to_bytes(size, "little") + body[place + size :]


def mutated(rng: random.Random, data: bytes, others: list[bytes]) -> tuple[str, bytes]:
    """Return a log that is changed in one to three ways, and which."""
    names = []
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        name = rng.choice(list(MUTATIONS))
        names.append(name)
        try:
            data = MUTATIONS[name](rng, data, others)
        except Exception:  # it was not whole any more
            data = _bytes(rng, data, others)
    return "+".join(names), data


def _records(data: bytes) -> list[Record]:
    return split(data[len(MAGIC) : -len(MAGIC)])


def _of_list(change: Callable[[random.Random, list[Record]], list[Record]]) -> Callable[..., bytes]:
    def mutate(rng: random.Random, data: bytes, others: list[bytes]) -> bytes:
        records = change(rng, _records(data))
        end = rng.random()
        return whole(indexed(records) if end < 0.3 else end_fitted(records) if end < 0.6 else records)

    return mutate


def _inside(change: Callable[[random.Random, list[Record]], list[Record]]) -> Callable[..., bytes]:
    def mutate(rng: random.Random, records: list[Record]) -> list[Record]:
        chunks = [k for k, (opcode, _) in enumerate(records) if opcode == Opcode.CHUNK]
        if not chunks:
            return change(rng, records)
        k = rng.choice(chunks)
        body = records[k][1]
        kind = Chunk.read(ReadDataStream(BytesIO(body))).compression
        records[k] = Opcode.CHUNK, packed(join(change(rng, split(opened(body)))), kind, body)
        return records

    return _of_list(mutate)


def _drop(rng: random.Random, records: list[Record]) -> list[Record]:
    del records[rng.randrange(len(records))]
    return records


def _repeat(rng: random.Random, records: list[Record]) -> list[Record]:
    k = rng.randrange(len(records))
    return [*records[:k], *[records[k]] * rng.choice((1, 1, 3, 20)), *records[k:]]


def _move(rng: random.Random, records: list[Record]) -> list[Record]:
    records.insert(rng.randrange(len(records)), records.pop(rng.randrange(len(records))))
    return records


def _field(rng: random.Random, records: list[Record]) -> list[Record]:
    k = rng.randrange(len(records))
    records[k] = changed(rng, records[k])
    return records


def _kind(rng: random.Random, records: list[Record]) -> list[Record]:
    k = rng.randrange(len(records))
    records[k] = rng.choice((*range(16), 16, 0x80, 0xFF)), records[k][1]
    return records


def _resize(rng: random.Random, records: list[Record]) -> list[Record]:
    k = rng.randrange(len(records))
    opcode, body = records[k]
    records[k] = opcode, body[: rng.randrange(len(body) + 1)] if rng.random() < 0.5 else body + rng.randbytes(16)
    return records


def _index(rng: random.Random, records: list[Record]) -> list[Record]:
    gone = {rng.choice((*SUMMARY, Opcode.MESSAGE_INDEX)) for _ in range(rng.randrange(1, 4))}
    return end_fitted([each for each in records if each[0] not in gone])


def _pack(rng: random.Random, records: list[Record]) -> list[Record]:
    return [
        (Opcode.CHUNK, packed(opened(body), rng.choice(("", "lz4", "zstd", "snappy", "none")), body))
        if opcode == Opcode.CHUNK and rng.random() < 0.7 else (opcode, body)
        for opcode, body in records
    ]  # fmt: skip


def _unpack(rng: random.Random, records: list[Record]) -> list[Record]:
    found: list[Record] = []
    for opcode, body in records:
        found += split(opened(body)) if opcode == Opcode.CHUNK and rng.random() < 0.7 else [(opcode, body)]
    return found


def _entries(rng: random.Random, records: list[Record]) -> list[Record]:
    for k, (opcode, body) in enumerate(records):
        if opcode == Opcode.MESSAGE_INDEX and rng.random() < 0.5:
            index = MessageIndex.read(ReadDataStream(BytesIO(body)))
            index.records = rng.choice((index.records[1:], index.records * 50, index.records[::-1], []))
            records[k] = _written(index)
    return records


def _length(rng: random.Random, data: bytes, others: list[bytes]) -> bytes:
    records = _records(data)
    k = rng.randrange(len(records))
    place = len(MAGIC) + len(join(records[:k])) + 1
    old = len(records[k][1])
    new = rng.choice((*NUMBERS, old + 1, max(old - 1, 0), old ^ (1 << rng.randrange(20)), len(data) - place - 8))
    return data[:place] + new.to_bytes(8, "little") + data[place + 8 :]


def _splice(rng: random.Random, data: bytes, others: list[bytes]) -> bytes:
    records, theirs = _records(data), _records(rng.choice(others))
    chunks = [each for each in theirs if each[0] in (Opcode.CHUNK, Opcode.MESSAGE, Opcode.METADATA, Opcode.ATTACHMENT)]
    k = rng.randrange(1, len(records))
    records = [*records[:k], rng.choice(chunks), *records[k + (rng.random() < 0.5) :]]
    return whole(indexed(records) if rng.random() < 0.5 else records)


def _bytes(rng: random.Random, data: bytes, others: list[bytes]) -> bytes:
    if not data:
        return data
    changed, k = bytearray(data), rng.randrange(len(data))
    kind = rng.randrange(5)
    if kind == 0:
        changed[k] ^= 1 << rng.randrange(8)
    elif kind == 1:
        changed[k : k + 8] = rng.choice(NUMBERS).to_bytes(8, "little")
    elif kind == 2:
        del changed[k : k + rng.choice((1, 9, 100))]
    elif kind == 3:
        changed[k:k] = rng.randbytes(rng.choice((1, 9, 100)))
    else:
        del changed[k:]
    return bytes(changed)


MUTATIONS: dict[str, Callable[[random.Random, bytes, list[bytes]], bytes]] = {
    "drop": _of_list(_drop), "repeat": _of_list(_repeat), "move": _of_list(_move), "field": _of_list(_field),
    "kind": _of_list(_kind), "resize": _of_list(_resize), "index": _of_list(_index), "compression": _of_list(_pack),
    "outside": _of_list(_unpack), "entries": _of_list(_entries), "drop inside": _inside(_drop),
    "repeat inside": _inside(_repeat), "move inside": _inside(_move), "field inside": _inside(_field),
    "kind inside": _inside(_kind), "resize inside": _inside(_resize), "length": _length, "splice": _splice,
    "bytes": _bytes,
}  # fmt: skip
