"""What people say about a log: that they reviewed it, a verdict, a star, tags, a note, notes at times. Files beside it:
a finished log is never written again."""

import json
import time
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated

from pydantic import Field, StrictBool
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT
from rtstack.log.errors import LogError
from rtstack.messages import StrictFloat
from rtstack.references.acceptance import SUFFIX as ACCEPTANCE
from rtstack.references.acceptance import AcceptanceError, AcceptanceState, keep_beside, load_acceptance, load_beside

SUFFIX = ".remarks.json"
REVIEWED = ".reviewed.json"
NOTES = ".notes.json"
SIDECARS = (REVIEWED, ACCEPTANCE, SUFFIX, NOTES)
MOST_TAGS = 16

# one word: the filter of a list of logs looks for words
Tag = Annotated[str, Field(min_length=1, max_length=32, pattern=r"^[^\p{C}\p{Z},]*$")]


class EpisodeVerdict(StrEnum):
    """What a person decided about a run straight after it."""

    KEPT = "kept"  # use it, whatever the run's own result says
    FAILED = "failed"  # the task was not done; keep it as an example of that
    DISCARD = "discard"  # leave it out of data sets


@checked(frozen=True, slots=True, config=STRICT)
class Remarks:
    """starred: it stays, whatever is pruned. tags: words that group logs; note: a few lines of text. verdict: None
    where it was not given."""

    starred: StrictBool = False
    tags: Annotated[tuple[Tag, ...], Field(max_length=MOST_TAGS)] = ()
    note: Annotated[str, Field(max_length=2000)] = ""
    verdict: EpisodeVerdict | None = None


@checked(frozen=True, slots=True, config=STRICT)
class Note:
    """What a person wrote at a time of a log. t_s: s after its first sample."""

    t_s: Annotated[StrictFloat, Field(ge=0.0, le=1e6, allow_inf_nan=False)]
    text: Annotated[str, Field(min_length=1, max_length=400)]


def load_notes(log: Path) -> list[Note]:
    """Return the notes at times of a log, none where there is no file. Raises LogError."""
    return load_beside(log.with_name(log.name + NOTES), list[Note], LogError)


def save_notes(log: Path, notes: list[Note]) -> None:
    """Keep the notes at times of a log: whole, or not at all. Raises LogError."""
    _keep(log, NOTES, json.dumps([asdict(note) for note in notes], indent=1, ensure_ascii=False) if notes else "")


def load_remarks(log: Path) -> Remarks:
    """Return what was said about a log, nothing where there is no file. Raises LogError."""
    return load_beside(log.with_name(log.name + SUFFIX), Remarks, LogError)


def save_remarks(log: Path, remarks: Remarks) -> None:
    """Keep what is said about a log: whole, or not at all. Nothing to say is no file. Raises LogError."""
    said = {name: value for name, value in asdict(remarks).items() if value is not None}  # as versions before wrote it
    _keep(log, SUFFIX, "" if remarks == Remarks() else json.dumps(said, indent=1, ensure_ascii=False))


def mark_reviewed(log: Path, by: str) -> None:
    """Mark a log as reviewed. Raises LogError."""
    _keep(log, REVIEWED, json.dumps({"by": by, "when": time.strftime("%Y-%m-%dT%H:%M:%S%z")}))


def _keep(log: Path, suffix: str, text: str) -> None:
    if not log.is_file():
        raise LogError(f"{log}: there is no such log")
    keep_beside(log.with_name(log.name + suffix), text, LogError)


def may_go(log: Path) -> bool:
    """True for a log that was reviewed, has no star, and is no accepted recording; False where that is not clear."""
    try:
        verdict, starred = load_acceptance(log).verdict, load_remarks(log).starred
    except (AcceptanceError, LogError):
        return False
    reviewed = log.with_name(log.name + REVIEWED).is_file() or verdict is AcceptanceState.REJECTED
    return reviewed and not starred and verdict is not AcceptanceState.ACCEPTED


def sidecars(log: Path) -> list[Path]:
    """Return the files that stand beside a log and mean nothing without it."""
    return [path for suffix in SIDECARS if (path := log.with_name(log.name + suffix)).is_file()]
