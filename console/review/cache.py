"""Which logs have columns, who makes them, and which make room: one folder a log, the least recently opened goes first.

A folder is named after the log's id, size and time of change. What a process that has gone has left unfinished is
begun again.
"""

import contextlib
import os
import shutil
import subprocess
import tempfile
import threading
from dataclasses import replace
from pathlib import Path

import psutil

from console.child_process import end, start, why_ended
from console.review.columns import INDEX, Index, LogColumns, read_index
from rtstack.log.analysis.offered import installed
from rtstack.log_folder.catalogue import LogEntry

FOLDER = ".review"
_READER = "reader"  # a file in each folder: who fills it
_LIMIT_BYTES = 4 << 30  # six ten-minute logs, or some three hundred trials
_AT_ONCE = 2  # two logs that are compared; another one waits
_REMEMBERED = 8  # logs whose indices are held, with their events
_END_S = 5.0


class ReviewCache:
    """The columns of the logs of one directory. May be used from any thread."""

    def __init__(self, logs: Path, limit_bytes: int = _LIMIT_BYTES) -> None:
        self._limit_bytes = limit_bytes
        self._lock = threading.Lock()
        self._readers: dict[Path, subprocess.Popen[bytes]] = {}
        self._done: dict[str, tuple[LogEntry, LogColumns]] = {}  # by id, the most recently looked up last
        self._borrowed: tempfile.TemporaryDirectory[str] | None = None
        self._directory = Path(logs) / FOLDER
        try:
            self._directory.mkdir(exist_ok=True)
            (self._directory / ".gitignore").write_text("*\n")
        except OSError:  # logs on a disk that we may not write to
            self._borrowed = tempfile.TemporaryDirectory(prefix="rtstack-review-")
            self._directory = Path(self._borrowed.name)

    def reopened(self, log_id: str) -> tuple[LogEntry, LogColumns] | None:
        """Return a log that was read to its end and has not changed since, without looking through all logs."""
        with self._lock, contextlib.suppress(OSError):
            entry, opened = self._done.pop(log_id, (None, None))
            if entry is None or opened is None:
                return None
            status = entry.path.stat()
            if (status.st_size, status.st_mtime_ns * 1e-9) == (entry.size_bytes, entry.modified_s):
                os.utime(opened.folder)
                self._done[log_id] = entry, opened
                return entry, opened
        return None

    def open(self, entry: LogEntry) -> LogColumns | None:
        """Return a log's columns as far as they are, None before; start their conversion. Never waits."""
        key = f"{entry.id}-{entry.size_bytes}-{int(entry.modified_s * 1e9)}"
        folder = self._directory / key
        with self._lock:
            self._finish()
            begun = folder in self._readers or _being_read(folder)  # before the index: a reader may end meanwhile
            if (index := read_index(folder)) is not None and index.done and _current(index, folder):
                os.utime(folder)
                self._done[entry.id] = entry, LogColumns(folder, index)
                while len(self._done) > _REMEMBERED:
                    del self._done[next(iter(self._done))]
            elif not begun and sum(process.poll() is None for process in self._readers.values()) < _AT_ONCE:
                self._make_room()
                self._done.pop(entry.id, None)
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                process = self._readers[folder] = start("console.review.conversion", str(entry.path), str(folder))
                try:
                    (folder / _READER).write_text(str(process.pid))
                except OSError:  # the disk is full: the reader could not write either
                    end(self._readers.pop(folder), _END_S)
                    raise
                index = None
            return None if index is None else LogColumns(folder, index)

    def being_read(self, entry: LogEntry) -> bool:
        """Whether a process, ours or another console's, reads this log now."""
        return any(_being_read(folder) for folder in self._directory.glob(f"{entry.id}-*"))

    def forget(self, entry: LogEntry) -> None:
        """Remove the columns of a log that is being deleted."""
        with self._lock:
            self._done.pop(entry.id, None)
            for folder in self._directory.glob(f"{entry.id}-*"):
                shutil.rmtree(folder, ignore_errors=True)

    def close(self) -> None:
        """End what is being read, and remove what it has begun."""
        with self._lock:
            for process in self._readers.values():
                process.terminate()
            for folder, process in self._readers.items():
                end(process, _END_S)
                index = read_index(folder)
                if index is None or not index.done:
                    shutil.rmtree(folder, ignore_errors=True)
            self._readers.clear()
            if self._borrowed is not None:
                self._borrowed.cleanup()

    def _finish(self) -> None:
        """Forget readers that have ended; one that ended early leaves a reason."""
        for folder, process in list(self._readers.items()):
            if process.poll() is None:
                continue
            del self._readers[folder]
            index = read_index(folder)
            if folder.is_dir() and (index is None or not index.done):
                failed = Index(0, 0.0, {}, error=why_ended(process.returncode))
                whole = index if index is not None and index.analyses else failed  # all was read before an analysis
                replace(whole, done=True).write(folder)

    def _make_room(self) -> None:
        folders = [path for path in self._directory.iterdir() if path.is_dir() and not _being_read(path)]
        sizes = {folder: sum(file.stat().st_blocks * 512 for file in folder.iterdir()) for folder in folders}
        total = sum(sizes.values())
        for folder in sorted(folders, key=lambda folder: folder.stat().st_mtime):
            if total <= self._limit_bytes:
                return
            shutil.rmtree(folder, ignore_errors=True)
            total -= sizes[folder]


def _current(index: Index, folder: Path) -> bool:
    """Whether an index has what the analyses say that are installed now, and whose files have not changed since."""
    if index.error is not None:
        return True
    written_s = (folder / INDEX).stat().st_mtime
    try:
        changed = any(Path(file).stat().st_mtime > written_s for file in index.sources)
    except OSError:
        return False
    return not changed and [(one.name, one.package) for one in index.analyses] == installed()


def _being_read(folder: Path) -> bool:
    """Whether a process, ours or another console's, fills this folder now."""
    index = read_index(folder)
    if index is not None and index.done:
        return False
    try:
        reader = psutil.Process(int((folder / _READER).read_text()))
        return reader.status() != psutil.STATUS_ZOMBIE and str(folder) in reader.cmdline()
    except (OSError, ValueError, psutil.Error):
        return False
