"""The audit trail: who did what with the robot, one JSON object a line, in a file that outlives every process.

The robot process writes what was done with the robot, the console who signed in, the command line what became of
tokens: each line is appended by one call, so that they do not mix.
"""

import json
import os
import sys
import threading
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

FILE_NAME = "audit.jsonl"  # in the folder of logs
_READ_BYTES = 1 << 20  # of the end of the file: some ten thousand lines


@checked(frozen=True, slots=True)
class AuditLine:
    """What was done (`action`, and `text` for people), by which operator (or None), and when (ISO 8601, UTC)."""

    time: str
    action: str
    operator: str | None
    text: str


_LINE = TypeAdapter(AuditLine)


class AuditTrail:
    """Appends to a file. Each line is handed to the kernel before `note` returns, so that no kill takes it back."""

    def __init__(self, path: Path) -> None:
        """Raises OSError where the file cannot be appended to."""
        self._path = path
        self._lock = threading.Lock()
        self._file = path.open("a+b", buffering=0)
        size = self._file.seek(0, os.SEEK_END)
        if size and os.pread(self._file.fileno(), 1, size - 1) != b"\n":  # the power went in the middle of a line
            self._file.write(b"\n")

    def note(self, action: str, operator: str | None, text: str) -> None:
        """Append what was done, by which operator (or None), in one line. Never raises: a full disk stops no STOP."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = {"time": now, "action": action, "operator": operator, "text": text}
        try:
            with self._lock:
                self._file.write(json.dumps(line, ensure_ascii=False).encode() + b"\n")
        except (OSError, ValueError) as error:
            print(f"rtstack: the audit trail is not being written: {error}", file=sys.stderr)

    def newest(self, count: int) -> list[AuditLine]:
        """Return the newest lines, oldest first; what is no line of ours is left out. Raises OSError."""
        with self._path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(0, size - _READ_BYTES))
            lines = file.read().split(b"\n")
        found: list[AuditLine] = []
        for line in reversed(lines):
            if len(found) == count:
                break
            with suppress(ValidationError):
                found.append(_LINE.validate_json(line))
        return found[::-1]

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._file.close()
