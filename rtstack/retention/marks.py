"""Which logs were reviewed: a small file beside a log, since a log that is finished is never written again."""

import json
import time
from pathlib import Path

from hal.files import write_whole
from rtstack.log.errors import LogError
from rtstack.references.acceptance import SUFFIX as ACCEPTANCE
from rtstack.references.acceptance import AcceptanceError, AcceptanceState, load_acceptance
from rtstack.retention.remarks import SUFFIX as REMARKS
from rtstack.retention.remarks import load_remarks

REVIEWED = ".reviewed.json"
SIDECARS = (REVIEWED, ACCEPTANCE, REMARKS)


def mark_reviewed(log: Path, by: str) -> None:
    """Mark a log as reviewed. Raises LogError."""
    if not log.is_file():
        raise LogError(f"{log}: there is no such log")
    path = log.with_name(log.name + REVIEWED)
    try:
        write_whole(path, json.dumps({"by": by, "when": time.strftime("%Y-%m-%dT%H:%M:%S%z")}) + "\n")
    except OSError as error:
        raise LogError(f"{path}: cannot be written: {error.strerror}") from None


def may_go(log: Path) -> bool:
    """Whether a log was reviewed, has no star, and is no reference: an accepted recording stays, and so does what is
    not clear."""
    try:
        verdict, starred = load_acceptance(log).verdict, load_remarks(log).starred
    except (AcceptanceError, LogError):
        return False
    if starred:
        return False
    reviewed = log.with_name(log.name + REVIEWED).is_file() or verdict is AcceptanceState.REJECTED
    return reviewed and verdict is not AcceptanceState.ACCEPTED


def sidecars(log: Path) -> list[Path]:
    """Return the files that stand beside a log and mean nothing without it."""
    paths = [log.with_name(log.name + suffix) for suffix in SIDECARS]
    return [path for path in paths if path.is_file()]
