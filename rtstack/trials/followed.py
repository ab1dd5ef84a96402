"""The file that a trial followed: named in its log by path and digest, found again from there, or attached whole."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from rtstack.log.reader import Log
from rtstack.log.writing.job import Attachment
from rtstack.trials.errors import TrialError

REFERENCE = "reference"  # the metadata record
ATTACHED = "reference.mcap"


@dataclass(frozen=True, slots=True)
class Followed:
    """A reference's file. whole: it goes into the log too."""

    path: Path
    whole: bool = False

    def record(self) -> dict[str, str]:
        """Return the metadata record `reference`: path, sha256 and bytes. Raises OSError."""
        content = self.path.read_bytes()
        return {"path": str(self.path.resolve()), "sha256": _digest(content), "bytes": str(len(content))}

    def attachments(self) -> tuple[Attachment, ...]:
        """Return what is attached of it. Raises OSError."""
        return (Attachment(ATTACHED, "application/octet-stream", self.path.read_bytes()),) if self.whole else ()


def followed_file(log: Log, name: str) -> tuple[str, bytes]:
    """Return digest and content of the file that a trial's log has followed: attached, at the path that the log says,
    beside the log, or in a campaign's folder. name: as its specification has it. Raises TrialError with one line where
    it is nowhere, or has changed."""
    if (attached := log.attachment(ATTACHED)) is not None:
        return _digest(attached), attached
    record = log.metadata.get(REFERENCE, {})
    wanted, folder = record.get("sha256"), log.path.parent
    known = Path(record.get("path", name))
    changed: Path | None = None
    for place in dict.fromkeys((known, folder / known.name, folder.parent / name, Path(name))):
        if place.is_file():
            content = place.read_bytes()
            if wanted in (None, _digest(content)):
                return _digest(content), content
            changed = changed or place
    if changed is not None:
        raise TrialError(f"{log.path}: {changed} is not the reference that it followed any more: put that one back")
    raise TrialError(
        f"{log.path}: its reference {known} is neither there nor attached: put it there or beside the log, "
        "or log trials with --whole-reference"
    )


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
