"""Logs that a person deleted: moved aside with what stands beside them, brought back whole, removed after a week.

A folder for each of them in LOGS/.trash, which no list of logs looks into: one rename each, on the same disk.
"""

import contextlib
import os
import secrets
import shutil
from dataclasses import dataclass
from pathlib import Path

from rtstack.log.errors import LogError
from rtstack.log_folder.remarks import sidecars

FOLDER = ".trash"
KEPT_DAYS = 7.0


@dataclass(frozen=True, slots=True)
class Trashed:
    """A deleted log. id: opaque; size_bytes: of the log; deleted_s: Unix time."""

    id: str
    name: str
    size_bytes: int
    deleted_s: float


def delete(log: Path) -> Trashed:
    """Move a log to the trash, with what stands beside it. Raises LogError; the log is then where it was."""
    beside = sidecars(log)
    folder = log.parent / FOLDER / secrets.token_hex(8)
    try:
        folder.mkdir(parents=True)
        os.rename(log, folder / log.name)  # first: without it the others mean nothing
        for path in beside:
            os.rename(path, folder / path.name)
        os.utime(folder)
    except OSError as error:
        with contextlib.suppress(OSError):
            folder.rmdir()
        raise LogError(f"{log}: cannot be moved to {folder.parent}: {error.strerror}") from None
    return _trashed(folder)


def trashed(logs: Path) -> list[Trashed]:
    """Return what was deleted in a folder of logs, the newest first."""
    found = []
    for folder in (logs / FOLDER).glob("*"):
        with contextlib.suppress(LogError, OSError):
            found.append(_trashed(folder))
    return sorted(found, key=lambda each: each.deleted_s, reverse=True)


def restore(logs: Path, trash_id: str) -> str:
    """Bring a log back with what stood beside it; return its name. Raises LogError."""
    known = {each.id: each.name for each in trashed(logs)}
    if trash_id not in known:
        raise LogError("it is not in the trash: it was brought back, or removed for good")
    folder, name = logs / FOLDER / trash_id, known[trash_id]
    if (logs / name).exists():
        raise LogError(f"there is another log {name} now: rename or delete that one first")
    try:
        for path in sorted(folder.iterdir(), key=lambda path: path.name == name):  # the log last
            os.rename(path, logs / path.name)
        folder.rmdir()
    except OSError as error:
        raise LogError(f"{name}: cannot be brought back: {error.strerror}") from None
    return name


def empty(logs: Path, before_s: float) -> list[Trashed]:
    """Remove for good what was deleted before this Unix time; return it. Raises LogError."""
    old = [each for each in trashed(logs) if each.deleted_s <= before_s]
    for each in old:
        try:
            shutil.rmtree(logs / FOLDER / each.id)
        except OSError as error:
            raise LogError(f"{each.name}: cannot be removed from the trash: {error.strerror}") from None
    return old


def _trashed(folder: Path) -> Trashed:
    log = next(folder.glob("*.mcap"), None)
    if log is None:
        raise LogError(f"{folder}: there is no log in it")
    return Trashed(folder.name, log.name, log.stat().st_size, folder.stat().st_mtime)
