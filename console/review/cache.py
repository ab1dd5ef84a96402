"""Which logs have columns, who makes them, and which make room: one folder a log, the least recently opened goes first.

A folder is named after the log's id, size and time of change, so that a log that has changed is read anew. While it is
being filled it carries our process's number, and nobody else touches it.
"""

import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path

import psutil

from console.review.columns import Index, read_index
from rtstack.log.catalogue import LogEntry

FOLDER = ".review"
_LIMIT_BYTES = 4 << 30  # six ten-minute logs, or some three hundred trials
_AT_ONCE = 2  # two logs that are compared; another one waits
_END_S = 5.0


@dataclass(frozen=True, slots=True)
class Opened:
    """Where a log's columns are, and how far they are; index is None until the first of them is there."""

    folder: Path
    index: Index | None


class ReviewCache:
    """The columns of the logs of one directory. May be used from any thread."""

    def __init__(self, logs: Path, limit_bytes: int = _LIMIT_BYTES) -> None:
        self._limit_bytes = limit_bytes
        self._lock = threading.Lock()
        self._readers: dict[str, subprocess.Popen[bytes]] = {}
        self._borrowed: tempfile.TemporaryDirectory[str] | None = None
        self._directory = Path(logs) / FOLDER
        try:
            self._directory.mkdir(exist_ok=True)
            (self._directory / ".gitignore").write_text("*\n")
        except OSError:  # logs on a disk that we may not write to
            self._borrowed = tempfile.TemporaryDirectory(prefix="rtstack-review-")
            self._directory = Path(self._borrowed.name)
        for folder in self._directory.glob("*.[0-9]*"):
            if not psutil.pid_exists(int(folder.suffix[1:])):
                shutil.rmtree(folder, ignore_errors=True)

    def open(self, entry: LogEntry) -> Opened:
        """Return a log's columns as far as they are, and have them made where nobody does. Never waits."""
        key = f"{entry.id}-{entry.size_bytes}-{int(entry.modified_s * 1e9)}"
        done, growing = self._directory / key, self._directory / f"{key}.{os.getpid()}"
        with self._lock:
            self._finish()
            index = read_index(done)
            if index is not None:
                os.utime(done)
                return Opened(done, index)
            if key not in self._readers and self._busy() < _AT_ONCE:
                self._make_room()
                shutil.rmtree(growing, ignore_errors=True)
                growing.mkdir()
                self._readers[key] = subprocess.Popen(
                    [sys.executable, "-m", "console.review.conversion", str(entry.path), str(growing)],
                    stdin=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
                )
            return Opened(growing, read_index(growing))

    def close(self) -> None:
        """End what is being read, and remove what it has begun."""
        with self._lock:
            for process in self._readers.values():
                process.terminate()
            for process in self._readers.values():
                try:
                    process.wait(_END_S)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
            for key in self._readers:
                shutil.rmtree(self._directory / f"{key}.{os.getpid()}", ignore_errors=True)
            self._readers.clear()
            if self._borrowed is not None:
                self._borrowed.cleanup()

    def _busy(self) -> int:
        return sum(process.poll() is None for process in self._readers.values())

    def _finish(self) -> None:
        """Give the folders of readers that have ended their final names; one that failed keeps its reason."""
        for key, process in list(self._readers.items()):
            if process.poll() is None:
                continue
            del self._readers[key]
            growing = self._directory / f"{key}.{os.getpid()}"
            index = read_index(growing)
            if index is None or not index.done:
                reason = f"reading it ended unexpectedly (status {process.returncode})"
                Index(0, 0.0, {}, done=True, error=reason).write(growing)
            with contextlib.suppress(OSError):  # another console was faster
                growing.rename(self._directory / key)

    def _make_room(self) -> None:
        folders = [path for path in self._directory.iterdir() if path.is_dir() and not path.suffix]
        sizes = {folder: sum(file.stat().st_blocks * 512 for file in folder.iterdir()) for folder in folders}
        total = sum(sizes.values())
        for folder in sorted(folders, key=lambda folder: folder.stat().st_mtime):
            if total <= self._limit_bytes:
                return
            shutil.rmtree(folder, ignore_errors=True)
            total -= sizes[folder]
