"""What people say about a log: that they reviewed it, a star, tags, a note. Small files beside it: a finished log is
never written again."""

import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from pydantic import Field, StrictBool, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT
from hal.base.files import write_whole
from rtstack.log.errors import LogError
from rtstack.references.acceptance import SUFFIX as ACCEPTANCE
from rtstack.references.acceptance import AcceptanceError, AcceptanceState, load_acceptance

SUFFIX = ".remarks.json"
REVIEWED = ".reviewed.json"
SIDECARS = (REVIEWED, ACCEPTANCE, SUFFIX)
MOST_TAGS = 16

# one word: the filter of a list of logs looks for words
Tag = Annotated[str, Field(min_length=1, max_length=32, pattern=r"^[^\p{C}\p{Z},]*$")]


@checked(frozen=True, slots=True, config=STRICT)
class Remarks:
    """starred: it stays, whatever is pruned. tags: words that group logs; note: a few lines of text."""

    starred: StrictBool = False
    tags: Annotated[tuple[Tag, ...], Field(max_length=MOST_TAGS)] = ()
    note: Annotated[str, Field(max_length=2000)] = ""


_REMARKS = TypeAdapter(Remarks)


def load_remarks(log: Path) -> Remarks:
    """Return what was said about a log, nothing where there is no file. Raises LogError."""
    path = log.with_name(log.name + SUFFIX)
    try:
        return _REMARKS.validate_json(path.read_bytes())
    except FileNotFoundError:
        return Remarks()
    except (OSError, ValidationError) as error:
        line = str(error).splitlines()[0]
        raise LogError(f"{path}: {line}; remove the file to begin anew") from None


def save_remarks(log: Path, remarks: Remarks) -> None:
    """Keep what is said about a log: whole, or not at all. Nothing to say is no file. Raises LogError."""
    path = log.with_name(log.name + SUFFIX)
    if not log.is_file():
        raise LogError(f"{log}: there is no such log")
    try:
        if remarks == Remarks():
            path.unlink(missing_ok=True)
        else:
            write_whole(path, json.dumps(asdict(remarks), indent=1, ensure_ascii=False) + "\n")
    except OSError as error:
        raise LogError(f"{path}: cannot be written: {error.strerror}") from None


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
