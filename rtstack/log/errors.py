"""What can go wrong with a log. Every message is one clear line."""

import shlex
from pathlib import Path


class LogError(Exception):
    """A log cannot be written, read or recovered: the message names the file and says why."""

    def __str__(self) -> str:
        """Return the message, with names from the file or the folder made printable: it stays one line."""
        return "".join(letter if letter.isprintable() else ascii(letter)[1:-1] for letter in super().__str__())


def remedy(path: Path) -> str:
    """Return what to do with a log that is damaged or cut off."""
    return f"recover it with `rtstack recover {shlex.quote(str(path))}`"


def damaged(path: Path, offset: int, cause: object) -> LogError:
    """Return the error of a log that is damaged at a byte of the file."""
    return LogError(f"{path} is damaged at byte {offset}: {remedy(path)} ({str(cause) or type(cause).__name__})")
