"""The audit trail: who did what with the robot, one JSON object a line, in a file that outlives every process."""

import json
import sys
import threading
from datetime import UTC, datetime
from pathlib import Path

FILE_NAME = "audit.jsonl"  # in the folder of logs


class AuditTrail:
    """Appends to a file. Each line is handed to the kernel before `note` returns, so that no kill takes it back."""

    def __init__(self, path: Path) -> None:
        """Raises OSError where the file cannot be appended to."""
        self._lock = threading.Lock()
        self._file = path.open("a+b", buffering=0)
        if not _ends_with_a_line(path):  # the power went in the middle of one
            self._file.write(b"\n")

    def note(self, action: str, operator: str | None, text: str) -> None:
        """Append what was done, by whom (None: by nobody), in one line. Never raises: a full disk stops no STOP."""
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = {"time": now, "action": action, "operator": operator, "text": text}
        try:
            with self._lock:
                self._file.write(json.dumps(line, ensure_ascii=False).encode() + b"\n")
        except (OSError, ValueError) as error:
            print(f"robot process: the audit trail is not being written: {error}", file=sys.stderr)

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._file.close()


def _ends_with_a_line(path: Path) -> bool:
    with path.open("rb") as file:
        size = file.seek(0, 2)
        if size == 0:
            return True
        file.seek(size - 1)
        return file.read(1) == b"\n"
