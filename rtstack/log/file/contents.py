"""What a log's file holds: where its chunks are, and everything small. By its summary, or by a scan."""

from dataclasses import dataclass, field
from typing import BinaryIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment as AttachmentRecord
from mcap.records import Channel, Chunk, ChunkIndex, Metadata, Schema

from rtstack.log.file.container import MAGIC, RECORD_HEADER, chunk_data, definitions, message_table, scan, tail_chunk
from rtstack.log.writing.job import Attachment


@dataclass(slots=True)
class Contents:
    """start_ns, end_ns: robot's time of the first and the last message."""

    schemas: dict[int, Schema]
    channels: dict[int, Channel]
    metadata: dict[str, dict[str, str]]
    attachments: list[Attachment]
    chunks: list[ChunkIndex | int | bytes]  # indexed, or the offset of a chunk record, or its data
    start_ns: int = 0
    end_ns: int = 0
    counts: dict[int, int] = field(default_factory=dict)  # messages of a channel


def contents_by_summary(file: BinaryIO) -> Contents:
    """Return what the summary says; by a scan where it says nothing."""
    file.seek(0)
    summary = make_reader(file).get_summary()
    if summary is None or (not summary.chunk_indexes and summary.channels):
        return contents_by_scan(file)
    contents = Contents(summary.schemas, summary.channels, {}, [], [*summary.chunk_indexes])
    contents.chunks.sort(key=lambda chunk: chunk.chunk_start_offset if isinstance(chunk, ChunkIndex) else 0)
    if summary.statistics is not None:
        contents.counts = dict(summary.statistics.channel_message_counts)
        contents.start_ns = summary.statistics.message_start_time
        contents.end_ns = summary.statistics.message_end_time
    for index in summary.metadata_indexes:
        file.seek(index.offset + RECORD_HEADER)
        _add_metadata(contents, ReadDataStream(file))
    for index in summary.attachment_indexes:
        file.seek(index.offset + RECORD_HEADER)
        _add_attachment(contents, ReadDataStream(file))
    return contents


def contents_by_scan(file: BinaryIO) -> Contents:
    """Return what is found record by record. A damaged chunk is left out."""
    contents = Contents({}, {}, {}, [], [])
    times: list[int] = []
    loose = bytearray()  # records outside of chunks, as if they were a chunk of their own
    end = len(MAGIC)
    for record in scan(file):
        end = record.offset + record.size
        if record.opcode == Opcode.CHUNK:
            try:
                data = chunk_data(Chunk.read(record.stream()))
            except Exception:  # a damaged chunk: each decompressor has its own error
                continue
            _add_chunk(contents, data, times)
            contents.chunks.append(record.offset)
        elif record.opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            loose += record.raw
        elif record.opcode == Opcode.METADATA:
            _add_metadata(contents, record.stream())
        elif record.opcode == Opcode.ATTACHMENT:
            _add_attachment(contents, record.stream())
    for data in (bytes(loose), tail_chunk(file, end)):
        if data:
            _add_chunk(contents, data, times)
            contents.chunks.append(data)
    if times:
        contents.start_ns, contents.end_ns = min(times), max(times)
    return contents


def _add_chunk(contents: Contents, data: bytes, times: list[int]) -> None:
    schemas, channels = definitions(data)
    contents.schemas.update(schemas)
    contents.channels.update(channels)
    table = message_table(data)
    if len(table.start):
        times += [int(table.log_time_ns.min()), int(table.log_time_ns.max())]
    for channel_id, count in zip(*np.unique(table.channel_id, return_counts=True), strict=True):
        contents.counts[int(channel_id)] = contents.counts.get(int(channel_id), 0) + int(count)


def _add_metadata(contents: Contents, stream: ReadDataStream) -> None:
    record = Metadata.read(stream)
    contents.metadata[record.name] = record.metadata


def _add_attachment(contents: Contents, stream: ReadDataStream) -> None:
    record = AttachmentRecord.read(stream)
    contents.attachments.append(Attachment(record.name, record.media_type, record.data))
