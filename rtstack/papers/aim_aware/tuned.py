"""Tunings in deploy/tunings, each valid for one state of a study's plan file."""

import hashlib
import json
import tomllib
from collections.abc import Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, TypeVar

from hal.base.configuration import ConfigurationError, load_toml
from rtstack.experiments.registration import UNDIGESTED

# keys of a study on which its tuning does not depend: a cell in lockstep gives what one in this process gives
NOT_TUNED_ON = (*UNDIGESTED, "marks", "contacts", "cell", "logs")


T = TypeVar("T")


def digest_of(*paths: Path) -> str:
    """Return the digest of the values in TOML files, without claims and contacts, whatever the order of keys."""
    values = [tomllib.loads(path.read_text(encoding="utf-8")) for path in paths]
    values = [{key: value for key, value in each.items() if key not in NOT_TUNED_ON} for each in values]
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


def tuning_file(name: str) -> Path:
    """Return the path of a study's tuning, which need not exist."""
    with as_file(files("deploy.tunings") / f"{name}.toml") as path:
        return path


def tuned_for(path: Path, name: str, kind: type[T], command: str, further: Sequence[Path] = ()) -> T:
    """Return the tuning of the study `name` at `path`. further: other files on which it depends.

    kind: has the `study_digest` for which it was found. Raises ConfigurationError with the command that finds it
    again."""
    tuning = tuning_file(name)
    if not tuning.exists():
        raise ConfigurationError(f"{path}: no tuning for {name} exists: find it with `{command}`")
    tuned: Any = load_toml(tuning, kind)
    if tuned.study_digest != digest_of(path, *further):
        raise ConfigurationError(f"{tuning} was found for another {path.name}: find it again with `{command}`")
    return tuned
