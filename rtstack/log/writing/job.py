"""What the parent hands to the log process: pickled into a nameless temporary file, a LogJob at the start and, before
the process is told to finish, the result with the Evidence."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rtstack.log.viewers.frames import CellFrames
from rtstack.log.writing.pictures import LoggedCamera


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file inside the log: the reference, the description of the cell, a URDF."""

    name: str
    media_type: str
    data: bytes


@dataclass(frozen=True, slots=True)
class LogJob:
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


def values_of(record: Mapping[str, str] | None) -> dict[str, Any]:
    """Return the values of a metadata record: what a text says as JSON, any other text as it is; none for None."""
    values: dict[str, Any] = {}
    for key, text in (record or {}).items():
        try:
            values[key] = json.loads(text)
        except ValueError:
            values[key] = text
    return values
