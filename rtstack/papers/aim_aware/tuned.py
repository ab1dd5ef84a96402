"""The tuning in deploy/tunings that belongs to a study's file, and to no other state of it."""

import hashlib
import json
import tomllib
from collections.abc import Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import Protocol, TypeVar

from hal.configuration import ConfigurationError, load_toml


class OfAStudy(Protocol):
    """A tuning, which knows from what it was found."""

    @property
    def study_digest(self) -> str: ...


T = TypeVar("T", bound=OfAStudy)


def digest_of(*paths: Path) -> str:
    """Return the digest of what TOML files say: a comment or the order of keys does not count."""
    values = [tomllib.loads(path.read_text(encoding="utf-8")) for path in paths]
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


def tuning_file(name: str) -> Path:
    """Return where the tuning of a study is, or would be."""
    with as_file(files("deploy.tunings") / f"{name}.toml") as path:
        return path


def tuned_for(path: Path, name: str, kind: type[T], command: str, further: Sequence[Path] = ()) -> T:
    """Return the tuning of the study `name` at `path`. further: files on which the tuning depends too.

    Raises ConfigurationError, with the command that finds it again.
    """
    tuning = tuning_file(name)
    if not tuning.exists():
        raise ConfigurationError(f"{path}: there is no tuning for {name}: find it with `{command}`")
    tuned = load_toml(tuning, kind)
    if tuned.study_digest != digest_of(path, *further):
        raise ConfigurationError(f"{tuning} was found for another {path.name}: find it again with `{command}`")
    return tuned
