"""The logs of a directory, with what was asked and what came out. A cache: the files are the truth."""

import contextlib
import hashlib
import json
import os
import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from mcap.opcode import Opcode

from rtstack.log.errors import LogError
from rtstack.log.file.container import is_complete, open_mcap, sections
from rtstack.log.file.contents import metadata_at
from rtstack.log.reader import read_log

CACHE = "catalogue.sqlite"
_VERSION = 2  # of the table: another one is thrown away and rebuilt


class LogCondition(StrEnum):
    COMPLETE = "complete"
    TRUNCATED = "truncated"  # cut off, or still being written
    FOREIGN = "foreign"  # no log of ours


@dataclass(frozen=True, slots=True)
class LogEntry:
    """One file of the directory. `id` is opaque and stays the same while the file grows.

    trial and result: these metadata records as the log has them. recorded: the time of day with which its record `time`
    begins, ISO 8601, UTC.
    """

    id: str
    path: Path
    kind: str
    trial: Mapping[str, str] | None
    result: Mapping[str, str] | None
    size_bytes: int
    modified_s: float
    condition: LogCondition
    recorded: str | None = None

    def __hash__(self) -> int:
        return hash((self.id, self.size_bytes, self.modified_s))


class Catalogue:
    """The logs (*.mcap) of one directory, cached in SQLite beside them where it is writable. A link to a file of
    another folder is not listed. patience_s: how long to wait for another process that writes the cache."""

    def __init__(self, directory: Path, patience_s: float = 5.0) -> None:
        self.directory = Path(directory)
        self._patience_s = patience_s
        self._entries: dict[str, LogEntry] = {}  # of the last look, by the file's name

    def entries(self) -> tuple[LogEntry, ...]:
        """Return all logs, the newest first, after reading those that are new or have changed.

        Raises LogError where the directory cannot be read.
        """
        try:
            files = [path for path in self.directory.iterdir() if path.suffix == ".mcap" and self._is_ours(path)]
        except OSError as error:
            raise LogError(f"cannot read {self.directory}: {error.strerror}") from error
        try:
            with contextlib.closing(_open(self.directory / CACHE, self._patience_s)) as cache:
                entries = _refresh(files, cache, self._entries)
        except sqlite3.Error:  # a directory that is not writable, or a cache that another process holds
            with contextlib.closing(_prepared(":memory:")) as cache:
                entries = _refresh(files, cache, self._entries)
        self._entries = {entry.path.name: entry for entry in entries}
        return tuple(sorted(entries, key=lambda entry: entry.modified_s, reverse=True))

    def entry(self, log_id: str) -> LogEntry:
        """Return the log of an id. Raises LogError where there is none."""
        for entry in self.entries():
            if entry.id == log_id:
                return entry
        raise LogError(f"there is no log {log_id}")

    def _is_ours(self, path: Path) -> bool:
        """Whether it is a file of this folder with a name in UTF-8: what is listed can be downloaded."""
        if os.fsencode(path.name).decode(errors="replace") != path.name:
            return False
        return path.is_file() and (not path.is_symlink() or path.resolve().is_relative_to(self.directory.resolve()))


def entry_of(path: Path) -> LogEntry:
    """Return what a list of logs would know of a file. Raises OSError where there is none."""
    with contextlib.closing(_prepared(":memory:")) as cache:
        return _entry(path, None, None, cache)


def _open(path: Path, patience_s: float) -> sqlite3.Connection:
    try:
        return _prepared(path, patience_s)
    except sqlite3.OperationalError:  # locked, or not writable: nothing is wrong with its content
        raise
    except sqlite3.DatabaseError:  # broken, or of another version
        path.unlink(missing_ok=True)
        return _prepared(path, patience_s)


def _prepared(path: Path | str, patience_s: float = 0.0) -> sqlite3.Connection:
    cache = sqlite3.connect(path, timeout=patience_s)
    try:
        version = cache.execute("PRAGMA user_version").fetchone()[0]
        if version not in (0, _VERSION):
            raise sqlite3.DatabaseError("another version")
        if version == 0:  # new; saying the version again would write and sync, at each look
            cache.execute(
                "CREATE TABLE IF NOT EXISTS logs (name TEXT PRIMARY KEY, size INTEGER, modified_ns INTEGER, entry TEXT)"
            )
            cache.execute(f"PRAGMA user_version = {_VERSION}")
            cache.commit()
    except sqlite3.DatabaseError:
        cache.close()
        raise
    return cache


def _refresh(files: list[Path], cache: sqlite3.Connection, last: Mapping[str, LogEntry]) -> list[LogEntry]:
    known = {row[0]: row[1:] for row in cache.execute("SELECT name, size, modified_ns, entry FROM logs")}
    entries = []
    for path in files:
        with contextlib.suppress(FileNotFoundError):  # removed meanwhile
            entries.append(_entry(path, last.get(path.name), known.get(path.name), cache))
    gone = [(name,) for name in known.keys() - {path.name for path in files}]
    cache.executemany("DELETE FROM logs WHERE name = ?", gone)
    cache.commit()
    return entries


def _entry(path: Path, last: LogEntry | None, known: tuple | None, cache: sqlite3.Connection) -> LogEntry:
    status = path.stat()
    if last is not None and (last.size_bytes, last.modified_s) == (status.st_size, status.st_mtime_ns * 1e-9):
        return last
    if known is not None and known[:2] == (status.st_size, status.st_mtime_ns):
        content = json.loads(known[2])
    else:
        condition, metadata = _read(path)
        trial = metadata.get("trial")
        content = {"condition": condition, "kind": (trial or {}).get("kind", "trial"), "trial": trial}
        content |= {"result": metadata.get("result"), "recorded": metadata.get("time", {}).get("utc")}
        name = os.fsencode(path.name).decode(errors="replace")  # SQLite takes no other text
        row = (name, status.st_size, status.st_mtime_ns, json.dumps(content))
        cache.execute("INSERT OR REPLACE INTO logs VALUES (?, ?, ?, ?)", row)
    log_id = hashlib.blake2b(path.name.encode("utf-8", "surrogateescape"), digest_size=16).hexdigest()
    return LogEntry(
        log_id, path, content["kind"], content["trial"], content["result"], status.st_size, status.st_mtime_ns * 1e-9,
        LogCondition(content["condition"]), content["recorded"],
    )  # fmt: skip


def _read(path: Path) -> tuple[LogCondition, dict[str, dict[str, str]]]:
    try:
        with open_mcap(path) as file:
            if not is_complete(file):
                metadata = {}
                for section in sections(file):
                    if section.opcode == Opcode.CHUNK:
                        break  # what was asked stands before the first data
                    if section.opcode == Opcode.METADATA:
                        parsed = metadata_at(file, section)
                        metadata[parsed.name] = parsed.metadata
                return LogCondition.TRUNCATED, metadata
        return LogCondition.COMPLETE, read_log(path).metadata
    except Exception:  # whatever is wrong with it, the other logs are still to be listed
        return LogCondition.FOREIGN, {}
