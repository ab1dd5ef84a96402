"""The audit trail: who did what with the robot, one JSON object a line, in a file that outlives every process.

Robot process, console and command line write it: each line is appended by one call, so that they do not mix.
"""

import errno
import json
import os
import sys
import threading
from collections import deque
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from pydantic import TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

FILE_NAME = "audit.jsonl"  # in the folder of logs
_READ_BYTES = 1 << 20  # of the end of the file: some ten thousand lines
_MOST_WAITING = 10_000  # lines that wait for a disk with room: 2 MB


@checked(frozen=True, slots=True)
class AuditLine:
    """What was done (`action`, and `text` for people), by which operator (or None), and when (ISO 8601, UTC)."""

    time: str
    action: str
    operator: str | None
    text: str


_LINE = TypeAdapter(AuditLine)


class AuditTrail:
    """Appends to a file. Each line is handed to the kernel before `note` returns, so that no kill takes it back; what
    cannot be written waits. Where the folder is moved or replaced, a new file begins at the path.
    """

    def __init__(self, path: Path) -> None:
        """Raises OSError where the file cannot be appended to."""
        self._path = path
        self._lock = threading.Lock()
        self._waiting: deque[bytes] = deque(maxlen=_MOST_WAITING)
        self._failed = False
        self._open()

    def note(self, action: str, operator: str | None, text: str) -> None:
        """Append what was done, by which operator (or None), in one line. Never raises: a full disk stops no STOP."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = {"time": now, "action": action, "operator": operator, "text": text}
        with self._lock:
            self._waiting.append(json.dumps(line, ensure_ascii=False).encode(errors="replace") + b"\n")
            self._write()

    def newest(self, count: int) -> list[AuditLine]:
        """Return the newest lines, oldest first; what is no line of ours is left out. Raises OSError."""
        with self._lock:
            self._follow()
            size = self._file.seek(0, os.SEEK_END)
            lines = os.pread(self._file.fileno(), _READ_BYTES, max(0, size - _READ_BYTES)).split(b"\n")
            lines += self._waiting
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
            self._write()
            self._file.close()

    def _open(self) -> None:
        self._file = self._path.open("a+b", buffering=0)
        size = self._file.seek(0, os.SEEK_END)
        self._cut = size > 0 and os.pread(self._file.fileno(), 1, size - 1) != b"\n"  # the power went in mid-line

    def _write(self) -> None:
        """Write the lines that wait, as far as the disk has room."""
        try:
            self._follow()
            while self._waiting:
                data = b"\n" * self._cut + self._waiting[0]
                written = self._file.write(data)
                self._cut = 0 < written < len(data) or (self._cut and written == 0)
                if written < len(data):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                self._waiting.popleft()
            self._failed = False
        except (OSError, ValueError) as error:
            if not self._failed:
                print(f"rtstack: {self._path}: the audit trail waits: {error}; make room", file=sys.stderr, flush=True)
            self._failed = True

    def _follow(self) -> None:
        """Open the file again where another one, or none, is at its path; where none can be made, keep it."""
        with suppress(OSError):
            if self._path.exists() and os.path.samestat(self._path.stat(), os.fstat(self._file.fileno())):
                return
            old = self._file
            self._open()
            old.close()
