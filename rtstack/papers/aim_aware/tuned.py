"""Which file is a study's, and the tuning in deploy/tunings that belongs to it and to no other state of it."""

import hashlib
import tomllib
from collections.abc import Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import Protocol, TypeVar

from rtstack.configuration import ConfigurationError, load_toml


class OfAStudy(Protocol):
    """A tuning, which knows from what it was found."""

    @property
    def study_digest(self) -> str: ...


T = TypeVar("T", bound=OfAStudy)


def digest_of(*contents: bytes) -> str:
    """Return the digest of files."""
    return hashlib.sha256(b"".join(hashlib.sha256(content).digest() for content in contents)).hexdigest()[:16]


def tuned_for(path: Path, name: str, kind: type[T], command: str, further: Sequence[Path] = ()) -> tuple[T, str]:
    """Return the tuning of the study `name` at `path`, and the digest of all on which its results depend but code.

    further: files on which the tuning depends too. Raises ConfigurationError, with the command that finds it again.
    """
    sources = [each.read_bytes() for each in (path, *further)]
    with as_file(files("deploy.tunings") / f"{name}.toml") as tuning:
        if not tuning.exists():
            raise ConfigurationError(f"{path}: there is no tuning for {name}: find it with `{command}`")
        tuned = load_toml(tuning, kind)
        content = tuning.read_bytes()
    if tuned.study_digest != digest_of(*sources):
        raise ConfigurationError(f"{tuning} was found for another {path.name}: find it again with `{command}`")
    return tuned, digest_of(*sources, content)


def study_kind(path: Path) -> str | None:
    """Return which study the file is of, None where it is one of a campaign of trials."""
    try:
        kind = tomllib.loads(path.read_text(encoding="utf-8")).get("study")
        return kind if isinstance(kind, str) else None
    except (OSError, ValueError):
        return None  # who reads it as a campaign says what is wrong
