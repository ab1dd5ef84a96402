"""The MCAP file while it is being written: foxglove-sdk behind topics, metadata, attachments; samples in batches."""

import json
import logging
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, BinaryIO

import foxglove
import numpy as np
from foxglove.mcap import MCAPCompression, MCAPWriteOptions
from numpy.typing import NDArray

from rtstack.log.time_of_day import RECORD, time_record
from rtstack.log.viewers.scenery import Messages, Scenery, scenery_schemas
from rtstack.log.viewers.standard import STANDARD
from rtstack.log.writing.encoding import sample_descriptors, wire_format
from rtstack.log.writing.job import Attachment, Evidence, LogJob, texts
from rtstack.log.writing.pictures import camera_schemas
from rtstack.samples import ARM_SAMPLE, SIDES
from rtstack.topics import ARM_TOPICS, OBJECT_TOPIC, TOPICS

# a killed writer loses at most 0.5 s (contract); the other half is for reading the rings and compressing
FLUSH_NS = 250_000_000
logging.getLogger("foxglove_py.mcap").setLevel(logging.CRITICAL)  # of a disk that refuses, OSError says it


class _File:
    """A file that remembers why a write failed: the SDK's own errors say only that one did."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.error: OSError | None = None

    def write(self, data: bytes | bytearray) -> int:
        return self._tried(self._file.write, data)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def flush(self) -> None:
        self._tried(self._file.flush)

    def _tried(self, call: Callable[..., Any], *arguments: object) -> Any:
        try:
            return call(*arguments)
        except OSError as error:
            self.error = error
            raise


class McapWriter:
    """Writes batches of records and finishes a chunk at least every 0.25 s, of robot's time and of wall time.

    Every method raises OSError when the disk refuses.
    """

    def __init__(
        self, file: BinaryIO, pictures: Mapping[str, foxglove.Schema] = {}, scenery: Scenery | None = None,
        times: NDArray[np.void] | None = None,
    ) -> None:  # fmt: skip
        """pictures: the topics of cameras. scenery: makes messages for viewers of the records.

        times: the run's TIMES (1,), None where the log is no recording.
        """
        self._file = _File(file)
        self._scenery = scenery
        # kept here: the channels hold no reference to their context, and fall silent without it
        self._context = context = foxglove.Context()
        # without seeking, a chunk is written in one piece: a killed writer leaves whole chunks behind
        lz4 = MCAPCompression.Lz4
        options = MCAPWriteOptions(compression=lz4, disable_seeking=True, chunk_size=None, compression_threads=0)
        self._writer = foxglove.open_mcap(self._file, context=context, writer_options=options)
        # as foxglove.Channel makes it, which keeps each one as long as the process lives: 150 kB a log
        self._channels = {
            topic: context._create_channel(topic, schema=schema, message_encoding=schema.encoding, metadata=None)
            for topic, schema in (topic_schemas() | dict(pictures)).items()
        }
        self.messages = dict.fromkeys(self._channels, 0)
        self._flushed_wall_ns = time.monotonic_ns()
        self._flushed_log_ns: int | None = None
        self._dirty = False
        self._times, self._timed = times if times is not None and times["opened_ns"][0] else None, False

    @classmethod
    def of_job(cls, file: BinaryIO, job: LogJob, times: NDArray[np.void]) -> "McapWriter":
        """Begin the file of a job. times: the run's."""
        schemas = (camera_schemas(camera.name, camera.video) for camera in job.cameras)
        pictures = {topic: schema for each in schemas for topic, schema in each.items()}
        writer = cls(file, pictures, Scenery(job.cell) if job.cell else None, times)
        writer.begin(job.metadata, job.attachments)
        return writer

    def begin(self, metadata: Iterable[tuple[str, dict[str, str]]], attachments: Iterable[Attachment]) -> None:
        """Write what a log begins with: metadata records, name and values, and attachments."""
        for name, values in metadata:
            self.write_metadata(name, values)
        for attachment in attachments:
            self.attach(attachment.name, attachment.media_type, attachment.data)

    def write_metadata(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record; one without values would be left out by the SDK, so it is not written."""
        self._guard(self._writer.write_metadata, name, values)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment. Its log time is 0: it belongs to the whole run."""
        about = {"name": name, "media_type": media_type, "data": data}
        self._guard(partial(self._writer.attach, log_time=0, create_time=time.time_ns(), **about))

    def write(self, batches: dict[str, NDArray], made: Messages | None = None) -> None:
        """Write records of all topics, and messages made from them (by default the scenery's), by robot's time."""
        if self._times is not None and not self._timed and self._times["unix_ns"][0, 0]:
            self._timed = True  # once here, for a log without an end
            self.write_metadata(RECORD, time_record(self._times))
        if made is None:
            if not any(map(len, batches.values())):
                return
            made = self._shown(batches)
        parts = []
        for topic, records in batches.items():
            # an object that was never seen is not in the log
            seen = records[records["seen"] != 0] if "seen" in (records.dtype.names or ()) else records
            parts.append((topic, np.maximum(seen["t_ns"], 0), encoded(topic, seen)))
        for topic, each in made.items():
            parts.append((topic, np.array([t for t, _ in each], np.int64), [message for _, message in each]))
        for topic, _, said in parts:
            self.messages[topic] += len(said)
        writes = [self._channels[topic].log for topic, _, said in parts for _ in said]
        messages = [message for _, _, said in parts for message in said]
        all_times = np.concatenate([t_ns for _, t_ns, _ in parts])
        order = np.argsort(all_times, kind="stable")
        due_ns = -1 if self._flushed_log_ns is None else self._flushed_log_ns + FLUSH_NS
        for row, t_ns in zip(order.tolist(), all_times[order].tolist(), strict=True):
            if t_ns >= due_ns:
                if self._flushed_log_ns is not None:
                    self.flush()
                self._flushed_log_ns = t_ns
                due_ns = t_ns + FLUSH_NS
            writes[row](messages[row], t_ns)
        self._dirty = self._dirty or bool(messages)

    def _shown(self, batches: dict[str, NDArray]) -> Messages:
        if self._scenery is None:
            return {}
        poses = batches[OBJECT_TOPIC]
        none = np.zeros(0, ARM_SAMPLE)  # of an arm that is not there
        arms = {side: batches.get(topic, none) for side, topic in zip(SIDES, ARM_TOPICS, strict=True)}
        return self._scenery.update(arms, poses[poses["seen"] != 0])

    def flush_if_due(self) -> None:
        """Finish the chunk when the last one is 0.25 s of wall time old."""
        if self._dirty and time.monotonic_ns() - self._flushed_wall_ns >= FLUSH_NS:
            self.flush()

    def flush(self) -> None:
        """Finish the chunk and hand it to the operating system."""
        self._guard(self._writer.flush)
        self._flushed_wall_ns = time.monotonic_ns()
        self._dirty = False

    def close(self) -> None:
        self._guard(self._writer.close)

    def finish(self, result: Mapping[str, Any], ended: str, evidence: Evidence | None, lost: Mapping[str, int]) -> None:
        """Write result, evidence and the account of what was lost, by topic, and finish the file."""
        counts = {topic: {"messages": n, "lost": lost.get(topic, 0)} for topic, n in self.messages.items()}
        if evidence is not None:
            for attachment in evidence.attachments:
                self.attach(attachment.name, attachment.media_type, attachment.data)
            if evidence.fault:
                self.write_metadata("fault", evidence.fault)
        if result:
            self.write_metadata("result", texts(result))
        if self._times is not None:
            self.write_metadata(RECORD, time_record(self._times, ended=True))
        messages, missed = (str(sum(each.values())) for each in (self.messages, lost))
        self.write_metadata("log", {"ended": ended, "messages": messages, "lost": missed, "topics": json.dumps(counts)})
        self.close()

    def _guard(self, call: Callable[..., None], *arguments: object) -> None:
        try:
            call(*arguments)
        except RuntimeError as error:
            raise self._file.error or OSError(str(error)) from error
        if self._file.error is not None:
            raise self._file.error


def topic_schemas() -> dict[str, foxglove.Schema]:
    of_records = {}
    for name, topic in TOPICS.items():
        schema = topic.message.schema
        ours = foxglove.Schema(name=schema, encoding="protobuf", data=sample_descriptors())
        of_records[name] = STANDARD[schema].schema if schema in STANDARD else ours
    return of_records | scenery_schemas()


def encoded(topic: str, records: NDArray) -> list[bytes]:
    message = TOPICS[topic].message
    if message.is_ours:
        return wire_format(message.name).encode(records)
    encode, frame = STANDARD[message.schema].encode, message.fields[0].frame
    return [encode(record, frame) for record in records]
