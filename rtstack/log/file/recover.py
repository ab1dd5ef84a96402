"""A log that was cut off, made whole: what is there is copied, indexes and summary are written anew."""

import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from hal.base.files import replacing
from rtstack.log.errors import LogError
from rtstack.log.file.container import (
    MAGIC,
    MESSAGE_HEADER,
    MessageTable,
    RawRecord,
    chunk_data,
    definitions,
    is_complete,
    message_table,
    open_mcap,
    scan,
    tail_chunk,
    walk,
)

_REWRITTEN = (Opcode.MESSAGE_INDEX, Opcode.DATA_END, Opcode.FOOTER)


@dataclass(frozen=True, slots=True)
class RecoverySummary:
    """What a recovery gave back. A complete log needs none: `complete`, and no `output`.

    messages: in the new file; last_t_ns: the newest log time, ns; damaged: chunks that could not be read.
    """

    path: Path
    output: Path | None
    complete: bool
    messages: int = 0
    last_t_ns: int = 0
    damaged: int = 0


def recover(
    path: Path, output: Path | None = None, progress: Callable[[int, int], None] | None = None
) -> RecoverySummary:
    """Copy everything up to the last complete record of `path` into a new, complete file.

    output: NAME.recovered.mcap beside the original by default; must not exist. The original is never touched.
    progress: called with bytes done and bytes in all. Raises LogError, also where no message is left: then nothing
    is written.
    """
    path = Path(path)
    with open_mcap(path) as source:
        if is_complete(source):
            return RecoverySummary(path, None, complete=True)
        output = path.with_suffix(".recovered.mcap") if output is None else Path(output)
        if output.exists():
            raise LogError(f"{output} exists already: remove it, or choose another name")
        try:
            with replacing(output) as partial, open(partial, "wb") as target:
                copy = _Copy(target)
                _copy_all(source, copy, progress)
                if not copy.counts:
                    chunks = f", and {copy.damaged} chunks that cannot be read" if copy.damaged else ""
                    raise LogError(f"{path} holds nothing to recover: no complete message{chunks}; nothing was written")
                copy.finish({"source": path.name, "damaged_chunks": str(copy.damaged)})
        except OSError as error:
            raise LogError(f"cannot write {output}: {error.strerror}") from error
    return RecoverySummary(path, output, False, sum(copy.counts.values()), copy.end_ns, copy.damaged)


def _copy_all(source: BinaryIO, copy: "_Copy", progress: Callable[[int, int], None] | None) -> None:
    total = os.fstat(source.fileno()).st_size
    end = len(MAGIC)
    if next((record.opcode for record in scan(source)), None) != Opcode.HEADER:
        raise LogError(f"{source.name} holds nothing to recover")
    for record in scan(source):
        copy.add(record)
        end = record.offset + record.size
        if progress is not None:
            progress(end, total)
    data = tail_chunk(source, end)
    data = data[: max((following for _, _, following in walk(data)), default=0)]
    if data:
        copy.add_chunk_of(data)


class _Copy:
    """The new file, and what its summary will say."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self.counts: Counter[int] = Counter()
        self.start_ns = 0
        self.end_ns = 0
        self.damaged = 0
        file.write(MAGIC)

    def add(self, record: RawRecord) -> None:
        """Copy a record as it is, except for the ones that are written anew; leave out one that is none inside."""
        offset = self._file.tell()
        try:
            if record.opcode == Opcode.CHUNK:
                self._add_chunk(record)
            elif record.opcode not in _REWRITTEN:
                self._file.write(record.raw)
                self._note(record, offset)
        except OSError:
            raise
        except Exception:  # the library raises whatever half a record makes of it
            self.damaged += 1
            self._file.seek(offset)
            self._file.truncate()

    def _note(self, record: RawRecord, offset: int) -> None:
        if record.opcode == Opcode.ATTACHMENT:
            a = Attachment.read(record.stream())
            self._attachments.append(
                AttachmentIndex(
                    offset=offset,
                    length=record.size,
                    create_time=a.create_time,
                    log_time=a.log_time,
                    data_size=len(a.data),
                    name=a.name,
                    media_type=a.media_type,
                )
            )
        elif record.opcode == Opcode.METADATA:
            name = Metadata.read(record.stream()).name
            self._metadata.append(MetadataIndex(offset=offset, length=record.size, name=name))
        elif record.opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            self._count(record.raw)

    def _count(self, data: bytes) -> MessageTable:
        schemas, channels = definitions(data)
        self._schemas.update(schemas)
        self._channels.update(channels)
        table = message_table(data)
        if len(table.log_time_ns):
            first, last = int(table.log_time_ns.min()), int(table.log_time_ns.max())
            self.start_ns = min(self.start_ns, first) if self.counts else first
            self.end_ns = max(self.end_ns, last)
        self.counts.update(table.channel_id.tolist())
        return table

    def _add_chunk(self, record: RawRecord) -> None:
        try:
            chunk = Chunk.read(record.stream())
            data = chunk_data(chunk)
        except Exception:  # each decompressor has its own error
            self.damaged += 1
            return
        self._put_chunk(chunk, record.raw, data)

    def add_chunk_of(self, data: bytes) -> None:
        """Write complete records as a chunk of their own."""
        times = message_table(data).log_time_ns
        chunk = Chunk(
            compression="lz4",
            data=lz4.frame.compress(data),
            message_start_time=int(times.min()) if len(times) else 0,
            message_end_time=int(times.max()) if len(times) else 0,
            uncompressed_crc=0,  # none
            uncompressed_size=len(data),
        )
        builder = RecordBuilder()
        chunk.write(builder)
        self._put_chunk(chunk, builder.end(), data)

    def _put_chunk(self, chunk: Chunk, record: bytes, data: bytes) -> None:
        start = self._file.tell()
        self._file.write(record)
        end = self._file.tell()
        table = self._count(data)
        offsets: dict[int, int] = {}
        for channel_id in np.unique(table.channel_id).tolist():
            rows = table.channel_id == channel_id
            positions = (table.start[rows] - MESSAGE_HEADER).tolist()
            offsets[channel_id] = self._file.tell()
            entries = list(zip(table.log_time_ns[rows].tolist(), positions, strict=True))
            self._write(MessageIndex(channel_id, entries))
        self._chunks.append(
            ChunkIndex(
                chunk_start_offset=start,
                chunk_length=end - start,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                uncompressed_size=chunk.uncompressed_size,
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                message_index_offsets=offsets,
                message_index_length=self._file.tell() - end,
            )
        )

    def finish(self, recovery: dict[str, str]) -> None:
        """Write the metadata record `recovery`, the end of the data, the summary and the footer."""
        metadata = Metadata("recovery", {**recovery, "messages": str(sum(self.counts.values()))})
        offset = self._file.tell()
        self._write(metadata)
        self._metadata.append(MetadataIndex(offset=offset, length=self._file.tell() - offset, name=metadata.name))
        self._write(DataEnd(data_section_crc=0))  # none
        summary_start = self._file.tell()
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, [*self._schemas.values()]),
            (Opcode.CHANNEL, [*self._channels.values()]),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, [*self._chunks]),
            (Opcode.ATTACHMENT_INDEX, [*self._attachments]),
            (Opcode.METADATA_INDEX, [*self._metadata]),
        ]
        offsets = [self._write_group(opcode, records) for opcode, records in groups if records]
        summary_offset_start = self._file.tell()
        for group in offsets:
            self._write(group)
        self._write(Footer(summary_start=summary_start, summary_offset_start=summary_offset_start, summary_crc=0))
        self._file.write(MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
            message_count=sum(self.counts.values()),
            schema_count=len(self._schemas),
            channel_count=len(self._channels),
            attachment_count=len(self._attachments),
            metadata_count=len(self._metadata),
            chunk_count=len(self._chunks),
            message_start_time=self.start_ns,
            message_end_time=self.end_ns,
            channel_message_counts=dict(self.counts),
        )

    def _write_group(self, opcode: Opcode, records: list[McapRecord]) -> SummaryOffset:
        start = self._file.tell()
        for record in records:
            self._write(record)
        return SummaryOffset(group_opcode=opcode, group_start=start, group_length=self._file.tell() - start)

    def _write(self, record: McapRecord) -> None:
        builder = RecordBuilder()
        record.write(builder)
        self._file.write(builder.end())
