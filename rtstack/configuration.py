"""TOML into frozen dataclasses: an unknown, missing or ill-typed key is one line that names it, with its place."""

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError

T = TypeVar("T")


class ConfigurationError(Exception):
    """A configuration that cannot be used. The message names the file, the key and what is wrong with it."""


def load_toml(path: Path, kind: type[T]) -> T:
    """Read `path` into the dataclass `kind`. Raises ConfigurationError with one line."""
    try:
        text = path.read_text(encoding="utf-8")
        document = tomllib.loads(text)
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        found = re.search(r" \(at line (\d+), column \d+\)", str(error))
        place = f"{path}:{found[1]}" if found else str(path)
        raise ConfigurationError(f"{place}: not valid TOML: {error}") from None
    return from_document(document, kind, str(path), text)


def place_of(source: str, text: str, key: Sequence[str | int]) -> str:
    """Return FILE:LINE of a key in a file's text; of its table, where it is missing; without a line, where that is too.

    key: names of tables and key, and numbers in arrays, from the outside.
    """
    lines: dict[tuple[str | int, ...], int] = {}
    table: tuple[str | int, ...] = ()
    counts: dict[tuple[str | int, ...], int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if header := re.match(r"\s*(\[\[?)([^\[\]]+)\]", line):
            table = _names(header[2])
            if header[1] == "[[":
                counts[table] = counts.get(table, -1) + 1
                table = (*table, counts[table])
            lines.setdefault(table, number)
        elif entry := re.match(r"""\s*([\w."'-]+)\s*=""", line):
            lines.setdefault((*table, *_names(entry[1])), number)
    for length in range(len(key), 0, -1):
        if number := lines.get(tuple(key[:length])):
            return f"{source}:{number}"
    return source


def _names(dotted: str) -> tuple[str | int, ...]:
    return tuple(name.strip().strip("\"'") for name in dotted.split("."))


def from_document(document: dict[str, Any], kind: type[T], source: str, text: str = "") -> T:
    """Check a parsed document against the dataclass `kind`. text: the file's, where there is one, for the line.

    Raises ConfigurationError with one line.
    """
    try:
        return TypeAdapter(kind).validate_python(document)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise ConfigurationError(f"{place_of(source, text, first['loc'])}: key {key}: {first['msg']}") from None


STRICT = ConfigDict(extra="forbid", strict=False, arbitrary_types_allowed=True)
