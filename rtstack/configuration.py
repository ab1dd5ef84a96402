"""TOML into frozen dataclasses: an unknown, missing or ill-typed key is one line that names it."""

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError

T = TypeVar("T")


class ConfigurationError(Exception):
    """A configuration that cannot be used. The message names the file, the key and what is wrong with it."""


def load_toml(path: Path, kind: type[T]) -> T:
    """Read `path` into the dataclass `kind`. Raises ConfigurationError with one line."""
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: not valid TOML: {error}") from None
    return from_document(document, kind, str(path))


def from_document(document: dict[str, Any], kind: type[T], source: str) -> T:
    """Check a parsed document against the dataclass `kind`. Raises ConfigurationError with one line."""
    try:
        return TypeAdapter(kind).validate_python(document)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ConfigurationError(f"{source}: key {key}: {first['msg']}") from None


STRICT = ConfigDict(extra="forbid", strict=False, arbitrary_types_allowed=True)
