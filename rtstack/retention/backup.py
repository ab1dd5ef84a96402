"""The catalogue and the marks beside the logs in one SQLite file, verified after writing; and back."""

import contextlib
import os
import sqlite3
import time
from pathlib import Path

from rtstack.log.catalogue import CACHE, Catalogue
from rtstack.log.errors import LogError
from rtstack.retention.marks import SIDECARS

BEFORE = CACHE + ".before-restore"
_MARKS = "sidecars"
_PATIENCE_S = 5.0


def back_up(logs: Path, output: Path) -> Path:
    """Write a backup of the catalogue of a folder, after bringing it up to date; returns its path.

    output: a file that does not exist yet, or a folder, in which it is named by the time. Raises LogError.
    """
    if output.is_dir():
        output /= f"catalogue-{time.strftime('%Y%m%d-%H%M%S')}.sqlite"
    if output.exists():
        raise LogError(f"{output} exists: choose another name")
    Catalogue(logs).entries()
    part = output.with_name(output.name + ".part")
    try:
        with _open(logs / CACHE) as source, contextlib.closing(sqlite3.connect(part)) as target:
            source.backup(target)
            target.execute(f"CREATE TABLE {_MARKS} (name TEXT PRIMARY KEY, content BLOB)")
            target.executemany(f"INSERT INTO {_MARKS} VALUES (?, ?)", _marks(logs).items())
            target.commit()
            rows = _rows(source)
        with _open(part) as written:
            if _rows(written) != rows or dict(written.execute(f"SELECT * FROM {_MARKS}")) != _marks(logs):
                raise LogError(f"{output}: what was written is not what was read; try again, and look at the disk")
        _sync(part)
        os.replace(part, output)
    except (OSError, sqlite3.Error) as error:
        raise LogError(f"{output}: no backup: {error}") from None
    finally:
        part.unlink(missing_ok=True)
    return output


def restore(logs: Path, backup: Path) -> tuple[int, int]:
    """Put a backup in the catalogue's place, and the marks beside the logs; returns how many logs and marks.

    The catalogue of before is kept beside it. Raises LogError, and then has changed nothing, where the backup is none.
    """
    if not logs.is_dir():
        raise LogError(f"{logs}: there is no such folder of logs")
    try:
        with _open(backup) as source:
            rows = _rows(source)
            marks = dict(source.execute(f"SELECT name, content FROM {_MARKS}"))
            if any(Path(name).name != name or not name.endswith(SIDECARS) for name in marks):
                raise LogError(f"{backup}: names a mark that is none of ours")
            if (logs / CACHE).exists():
                with _open(logs / CACHE) as present, contextlib.closing(sqlite3.connect(logs / BEFORE)) as kept:
                    present.backup(kept)
            with contextlib.closing(sqlite3.connect(logs / CACHE, timeout=_PATIENCE_S)) as target:
                source.backup(target)
                target.execute(f"DROP TABLE {_MARKS}")
                target.commit()
                if _rows(target) != rows:
                    raise LogError(f"{logs / CACHE}: what was written is not what was read; look at the disk")
        for name, content in marks.items():
            (logs / name).write_bytes(content)
    except (OSError, sqlite3.Error) as error:
        raise LogError(f"{backup}: cannot be restored: {error}") from None
    return len(rows) - 1, len(marks)


@contextlib.contextmanager
def _open(path: Path):
    """Open a database that is there and whole, to read."""
    with contextlib.closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True, timeout=_PATIENCE_S)) as base:
        if (found := base.execute("PRAGMA integrity_check").fetchone()[0]) != "ok":
            raise LogError(f"{path}: damaged: {found}")
        yield base


def _rows(base: sqlite3.Connection) -> list[tuple]:
    version = base.execute("PRAGMA user_version").fetchone()
    return [version, *base.execute("SELECT name, size, modified_ns, entry FROM logs ORDER BY name")]


def _marks(logs: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in logs.iterdir() if path.name.endswith(SIDECARS) and path.is_file()}


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
