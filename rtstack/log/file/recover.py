"""A log that was cut off or damaged, made whole: what can be read in it is written anew, by the library's writer."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.records import AttachmentIndex, Header, Metadata
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from hal.base.files import replacing
from rtstack.log.errors import LogError
from rtstack.log.file.container import MAGIC, MESSAGE, RECORD_HEADER, end_of, open_mcap
from rtstack.log.file.contents import Part, attachment_data, read_contents
from rtstack.log.file.salvage import Salvage


@dataclass(frozen=True, slots=True)
class RecoverySummary:
    """What a recovery gave back; a complete log needs none: `complete`, and no `output`.

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
    with open_mcap(path, any_start=True) as source:
        if _is_whole(source):
            return RecoverySummary(None, complete=True)
        output = path.with_suffix(".recovered.mcap") if output is None else Path(output)
        if output.exists():
            raise LogError(f"{output} exists already: remove it, or choose another name")
        try:
            with replacing(output) as partial, open(partial, "wb") as target:
                copy = _Copy(source, target)
                copy.run(progress or (lambda done, total: None))
                copy.finish()
                return RecoverySummary(output, False, copy.messages, copy.last_ns, tuple(copy.missing))
        except OSError as error:
            raise LogError(f"cannot write {output}: {error.strerror}") from error


def _is_whole(file: BinaryIO) -> bool:
    """Whether everything in a file can be read: the counts of its summary, and every checksum that it has."""
    end, crc = end_of(file), 0
    file.seek(0)
    if end is None or file.read(len(MAGIC)) != MAGIC:
        return False
    try:
        for place in read_contents(file, end, trusts=False).attachments:
            attachment_data(file, place)
        read_contents(file, end)  # as the reader does
    except LogError:
        return False
    file.seek(end.data + RECORD_HEADER)
    wanted = int.from_bytes(file.read(4), "little")
    file.seek(0)
    while block := file.read(min(1 << 20, end.data - file.tell())):
        crc = zlib.crc32(block, crc)
    return wanted in (0, crc)


class _Copy(Salvage):
    """What can be read in a file, on its way into a new one."""

    def __init__(self, source: BinaryIO, target: BinaryIO) -> None:
        super().__init__(source)
        self._path = Path(source.name)
        self._writer = Writer(target, compression=CompressionType.LZ4)
        self._schemas, self._channels = {0: 0}, dict[int, int]()  # numbers in the new file, by those in the old one
        self.messages = self.last_ns = 0
        try:
            source.seek(len(MAGIC) + RECORD_HEADER)
            header = Header.read(ReadDataStream(source))
        except Exception:  # the library raises whatever half a record makes of it
            header = Header("", "")
        self._writer.start(header.profile, header.library)

    def keep_messages(self, data: bytes, table: NDArray[Any], part: Part) -> None:
        for number, log_ns, start, size in table.tolist():
            sequence, publish_ns = MESSAGE.unpack_from(data, start - MESSAGE.size)[3::2]
            self._writer.add_message(self._channel(number), log_ns, data[start : start + size], publish_ns, sequence)
            self.last_ns = max(self.last_ns, log_ns)
        self.messages += len(table)

    def keep_metadata(self, metadata: Metadata) -> None:
        self._writer.add_metadata(metadata.name, metadata.metadata)

    def keep_attachment(self, place: AttachmentIndex, data: bytes) -> None:
        self._writer.add_attachment(place.create_time, place.log_time, place.name, place.media_type, data)

    def _channel(self, number: int) -> int:
        """Return the number of a channel in the new file."""
        if number not in self._channels:
            channel = self.contents.channels[number]
            schema = self.contents.schemas.get(channel.schema_id)
            if schema is not None and schema.id not in self._schemas:
                self._schemas[schema.id] = self._writer.register_schema(schema.name, schema.encoding, schema.data)
            schema_id = self._schemas.get(channel.schema_id, 0)
            made = self._writer.register_channel(channel.topic, channel.message_encoding, schema_id, channel.metadata)
            self._channels[number] = made
        return self._channels[number]

    def finish(self) -> None:
        """Write the metadata record `recovery` and the end. Raises LogError where no message was found."""
        if not self.messages:
            what = f", and {len(self.missing)} chunks that cannot be read" if self.missing else ""
            raise LogError(f"{self._path} holds nothing to recover: no complete message{what}; nothing was written")
        for number in self.contents.channels:  # also those without a message
            self._channel(number)
        found = {"source": self._path.name, "damaged_chunks": str(len(self.missing)), "messages": str(self.messages)}
        missing = {"missing": "; ".join(self.missing)} if self.missing else {}
        self._writer.add_metadata("recovery", found | missing)
        self._writer.finish()
