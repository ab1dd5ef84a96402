"""Files that several processes share: written whole or not at all, and changed by one process at a time."""

import fcntl
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PARTIAL = ".part"  # how the name of a file ends that is being written


@contextmanager
def replacing(path: Path, durable: bool = True, mode: int = 0o666) -> Iterator[Path]:
    """Give the path of a new file beside `path`; it takes its place when the block ends, and is removed otherwise: a
    reader sees the old file or the new one; durable: also after a power failure.

    mode: permissions, less the process's mask. Raises OSError.
    """
    new = path.with_name(f".{path.name}.{secrets.token_hex(4)}{PARTIAL}")
    os.close(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode))
    try:
        yield new
        if durable:
            keep(new)
        os.replace(new, path)
        if durable:
            keep(path.parent)
    finally:
        new.unlink(missing_ok=True)


def keep(path: Path) -> None:
    """Wait until the disk has a file's content, or the names in a folder, against a power failure. Raises OSError."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_whole(path: Path, content: str | bytes, durable: bool = True, mode: int = 0o666) -> None:
    """Replace a file's content in one step. Text is written as UTF-8. See `replacing`. Raises OSError."""
    with replacing(path, durable, mode) as new:
        new.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def locked(path: Path, shared: bool = False, wait: bool = True) -> Iterator[None]:
    """Hold the lock of a file, which is made if it is not there, or of a folder. It ends with the process, too.

    shared: beside others that share it. Raises OSError, BlockingIOError where wait is False and another one holds it.
    """
    flags = os.O_RDONLY if path.is_dir() else os.O_RDWR | os.O_CREAT
    descriptor = os.open(path, flags | os.O_CLOEXEC, 0o666)
    try:
        kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        fcntl.flock(descriptor, kind if wait else kind | fcntl.LOCK_NB)
        yield
    finally:
        os.close(descriptor)
