"""A person's verdict on a recording, in a small file beside it: a log that is finished is never written again."""

import json
from collections.abc import Callable
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from hal.base.configuration import STRICT
from hal.base.files import write_whole
from rtstack.messages import StrictFloat

SUFFIX = ".accepted.json"
T = TypeVar("T")

Seconds = Annotated[StrictFloat, Field(ge=0.0, le=3600.0, allow_inf_nan=False)]


class AcceptanceError(Exception):
    """The file beside a recording cannot be read or written. The message is one line."""


class AcceptanceState(StrEnum):
    """Whether a recording may be followed."""

    OPEN = "open"
    ACCEPTED = "accepted"
    REJECTED = "rejected"


@checked(frozen=True, slots=True, config=STRICT)
class Acceptance:
    """Times are s since the recording's start, whatever is cut off. nominal_impact_s: in the place of the detected
    impact; None where that one is right. from_s, to_s: what is used of the recording; None: from its start, to its end.
    """

    name: Annotated[str, Field(max_length=80, pattern=r"^\P{C}*$")] = ""
    note: Annotated[str, Field(max_length=2000)] = ""
    verdict: AcceptanceState = AcceptanceState.OPEN
    nominal_impact_s: Seconds | None = None
    from_s: Seconds | None = None
    to_s: Seconds | None = None


def acceptance_file(recording: Path) -> Path:
    """Return where a recording's acceptance is kept."""
    return recording.with_name(recording.name + SUFFIX)


def load_acceptance(recording: Path) -> Acceptance:
    """Return what was said about a recording, an open one where nothing was. Raises AcceptanceError."""
    return load_beside(acceptance_file(recording), Acceptance, AcceptanceError)


def save_acceptance(recording: Path, acceptance: Acceptance) -> None:
    """Keep what is said about a recording: whole, or not at all. Raises AcceptanceError."""
    keep_beside(acceptance_file(recording), json.dumps(asdict(acceptance), indent=1), AcceptanceError)


def load_beside(path: Path, kind: type[T], refused: Callable[[str], Exception], anew: str = "to begin anew") -> T:
    """Return what a small file beside a log says, `kind()` where there is none. Raises `refused` for a broken one."""
    try:
        content = path.read_bytes()  # most logs have none
        return TypeAdapter(kind).validate_json(content)
    except FileNotFoundError:
        return kind()
    except (OSError, ValidationError) as error:
        line = str(error).splitlines()[0]
        raise refused(f"{path}: {line}; remove the file {anew}") from None


def keep_beside(path: Path, text: str, refused: Callable[[str], Exception]) -> None:
    """Write a small file beside a log: whole, or not at all; none for an empty text. Raises `refused`."""
    try:
        if text:
            write_whole(path, text + "\n")
        else:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise refused(f"{path}: cannot be written: {error.strerror}") from None
