"""A log that was cut off, made whole: what is there is written anew, by the library's writer."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk, Header, Metadata
from mcap.writer import CompressionType, Writer

from hal.base.files import replacing
from rtstack.log.errors import LogError
from rtstack.log.file import container


@dataclass(frozen=True, slots=True)
class RecoverySummary:
    """What a recovery gave back. A complete log needs none: `complete`, and no `output`.

    messages: in the new file; last_t_ns: the newest log time, ns; damaged: chunks that could not be read.
    """

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
    with container.open_mcap(path) as source:
        if container.is_complete(source):
            return RecoverySummary(None, complete=True)
        output = path.with_suffix(".recovered.mcap") if output is None else Path(output)
        if output.exists():
            raise LogError(f"{output} exists already: remove it, or choose another name")
        try:
            with replacing(output) as partial, open(partial, "wb") as target:
                copy = _Copy(target)
                copy.add_all(source, progress)
                if not copy.messages:
                    chunks = f", and {copy.damaged} chunks that cannot be read" if copy.damaged else ""
                    raise LogError(f"{path} holds nothing to recover: no complete message{chunks}; nothing was written")
                copy.finish(path.name)
        except OSError as error:
            raise LogError(f"cannot write {output}: {error.strerror}") from error
    return RecoverySummary(output, False, copy.messages, copy.last_ns, copy.damaged)


class _Copy:
    """The new file."""

    def __init__(self, file: BinaryIO) -> None:
        self._writer = Writer(file, compression=CompressionType.LZ4)
        self._schemas, self._channels = {0: 0}, dict[int, int]()  # numbers in the new file, by those in the old one
        self.messages = self.last_ns = self.damaged = 0

    def add_all(self, source: BinaryIO, progress: Callable[[int, int], None] | None) -> None:
        """Copy what a file has, up to its last complete record. progress: see `recover`."""
        total, end = os.fstat(source.fileno()).st_size, len(container.MAGIC)
        if next((record.opcode for record in container.scan(source)), None) != Opcode.HEADER:
            raise LogError(f"{source.name} holds nothing to recover")
        for record in container.scan(source):
            self.add(record)
            end = record.offset + record.size
            if progress is not None:
                progress(end, total)
        self.add_data(container.tail_chunk(source, end))

    def add(self, record: container.RawRecord) -> None:
        """Copy what a record has; leave out, and count, one that is none inside."""
        try:
            if record.opcode == Opcode.HEADER:
                header = Header.read(record.stream())
                self._writer.start(header.profile, header.library)
            elif record.opcode == Opcode.CHUNK:
                self.add_data(container.chunk_data(Chunk.read(record.stream())))
            elif record.opcode == Opcode.ATTACHMENT:
                a = Attachment.read(record.stream())
                self._writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
            elif record.opcode == Opcode.METADATA:
                metadata = Metadata.read(record.stream())
                self._writer.add_metadata(metadata.name, metadata.metadata)
            else:
                self.add_data(record.raw)
        except OSError:
            raise
        except Exception:  # the library raises whatever half a record makes of it, and each decompressor its own error
            self.damaged += 1

    def add_data(self, data: bytes) -> None:
        """Copy the complete schemas, channels and messages of a chunk's data."""
        schemas, channels = container.definitions(data)
        for number, schema in schemas.items():
            if number not in self._schemas:
                self._schemas[number] = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        for number, channel in channels.items():
            if number not in self._channels:
                self._channels[number] = self._writer.register_channel(
                    channel.topic, channel.message_encoding, self._schemas[channel.schema_id], channel.metadata
                )
        for opcode, position, following in container.walk(data):
            if opcode != Opcode.MESSAGE:
                continue
            _, _, number, sequence, log_ns, publish_ns = container.MESSAGE.unpack_from(data, position)
            if number in self._channels:  # else a damaged chunk had its schema, without which no program can read it
                content = data[position + container.MESSAGE.size : following]
                self._writer.add_message(self._channels[number], log_ns, content, publish_ns, sequence)
                self.messages, self.last_ns = self.messages + 1, max(self.last_ns, log_ns)

    def finish(self, source: str) -> None:
        """Write the metadata record `recovery`, the end of the data, the summary and the footer."""
        found = {"source": source, "damaged_chunks": str(self.damaged), "messages": str(self.messages)}
        self._writer.add_metadata("recovery", found)
        self._writer.finish()
