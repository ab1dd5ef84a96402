"""The queue's file in the folder of logs: written whole or not at all, so that a restart finds what there was."""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from console.queue.entry import Entry, EntryState
from hal.files import write_whole

FILE_NAME = "queue.json"
INTERRUPTED = "the console ended while it ran"

_ENTRIES = TypeAdapter(tuple[Entry, ...])


class QueueFileError(Exception):
    """The file cannot be read or written. The message is one line."""


def load_entries(path: Path) -> tuple[Entry, ...]:
    """Return the entries, none where there is no file; what ran is stopped. Raises QueueFileError."""
    try:
        entries = _ENTRIES.validate_json(path.read_bytes())
    except FileNotFoundError:
        return ()
    except (OSError, ValidationError) as error:
        line = str(error).splitlines()[0]
        raise QueueFileError(f"{path}: {line}; remove the file to begin with an empty queue") from None
    return tuple(
        replace(entry, state=EntryState.STOPPED, reason=INTERRUPTED) if entry.state is EntryState.RUNNING else entry
        for entry in entries
    )


def save_entries(path: Path, entries: Sequence[Entry]) -> None:
    """Keep the entries. Raises QueueFileError."""
    try:
        write_whole(path, json.dumps([asdict(entry) for entry in entries], indent=1), durable=True)
    except OSError as error:
        raise QueueFileError(f"{path}: cannot be written: {error.strerror}") from None
