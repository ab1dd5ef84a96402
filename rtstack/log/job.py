"""What the parent hands to the log process, through a nameless temporary file that both have open."""

import json
import os
import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

from rtstack.log.frames import CellFrames
from rtstack.log.pictures import LoggedCamera

_HEADER = 8  # bytes of the job's length; the result follows the job


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file inside the log: the reference, the description of the cell, a URDF."""

    name: str
    media_type: str
    data: bytes


@dataclass(frozen=True, slots=True)
class LogJob:
    """One log to write."""

    rings: str
    metadata: tuple[tuple[str, dict[str, str]], ...]
    attachments: tuple[Attachment, ...]
    cell: CellFrames | None
    cameras: tuple[LoggedCamera, ...] = ()


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a run leaves behind that ended in a fault: a metadata record `fault`, and files."""

    fault: dict[str, str]
    attachments: tuple[Attachment, ...]


def texts(values: Mapping[str, Any]) -> dict[str, str]:
    """Return the values of a metadata record as MCAP has them: text as it is, anything else as JSON."""
    return {key: value if isinstance(value, str) else json.dumps(value) for key, value in values.items()}


def put_job(file: BinaryIO, job: LogJob) -> None:
    """Write the job; called once, before the process starts."""
    data = pickle.dumps(job)
    file.write(len(data).to_bytes(_HEADER, "little") + data)
    file.flush()


def get_job(descriptor: int) -> LogJob:
    """Read the job. pread: both processes share one file position."""
    return pickle.loads(_read(descriptor, _HEADER, _job_size(descriptor)))


def put_result(file: BinaryIO, result: Mapping[str, Any], evidence: Evidence | None = None) -> None:
    """Write the result and the evidence behind the job; called once, before the process is told to finish."""
    os.pwrite(file.fileno(), pickle.dumps((texts(result), evidence)), _HEADER + _job_size(file.fileno()))


def get_result(descriptor: int) -> tuple[dict[str, str], Evidence | None]:
    """Read the result, empty where the parent gave none, and the evidence."""
    start = _HEADER + _job_size(descriptor)
    size = os.fstat(descriptor).st_size - start
    return pickle.loads(_read(descriptor, start, size)) if size > 0 else ({}, None)


def _job_size(descriptor: int) -> int:
    return int.from_bytes(_read(descriptor, 0, _HEADER), "little")


def _read(descriptor: int, start: int, size: int) -> bytes:
    parts = []
    while size > 0:
        part = os.pread(descriptor, size, start)
        if not part:
            raise EOFError("the log's job is cut off")
        parts.append(part)
        start, size = start + len(part), size - len(part)
    return b"".join(parts)
