"""TOML into frozen dataclasses, and back: an unknown, missing or ill-typed key is one line with its name and place.

Values are taken as they are written: neither a text nor true is a number. A list becomes a tuple, an integer may stand
for a float. The floats of a dataclass without a configuration of its own are finite.
"""

import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

# numbers of a file: none of them infinite or NaN
Real = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
T = TypeVar("T")


class ConfigurationError(Exception):
    """A configuration that cannot be used. The message names the file, the key and what is wrong with it."""


def load_toml(path: Path, kind: type[T]) -> T:
    """Read `path` into the dataclass `kind`. Raises ConfigurationError with one line."""
    document, text = read_toml(path)
    return from_document(document, kind, str(path), text)


def read_toml(path: Path) -> tuple[dict[str, Any], str]:
    """Return what a file says, parsed and as text. Raises ConfigurationError with one line."""
    try:
        text = path.read_text(encoding="utf-8")
        return tomllib.loads(text), text
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:  # a path with a NUL or a number of thousands of digits: ValueError
        found = re.search(r" \(at line (\d+), column \d+\)", str(error))
        place = f"{path}:{found[1]}" if found else str(path)
        raise ConfigurationError(one_line(f"{place}: not valid TOML: {error}")) from None


def place_of(source: str, text: str, key: Sequence[str | int]) -> str:
    """Return FILE:LINE of a key in a file's text; of its table, where it is missing; without a line, where that is too.

    key: names of tables and key, and numbers in arrays, from the outside.
    """
    lines = _lines_of(text)
    for length in range(len(key), 0, -1):
        if number := lines.get(tuple(key[:length])):
            return f"{source}:{number}"
    return source


def _lines_of(text: str) -> dict[tuple[str | int, ...], int]:
    """Return the line, from 1, of each table and key."""
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
    return lines


def with_values(text: str, values: dict[tuple[str, ...], Any]) -> str:
    """Return a TOML file's text with other values of some keys; comments and everything else stay.

    values: by the names of table and key. A key that is not there comes below its table's name, a table at the end.
    """
    for key, value in reversed(values.items()):
        lines, found = text.splitlines(), _lines_of(text)
        written = value.isoformat() if hasattr(value, "isoformat") else json.dumps(value, allow_nan=False)
        line = f"{_key(key[-1])} = {written}"
        if number := found.get(key):
            end = number
            while not _is_toml("\n".join(lines[number - 1 : end])) and end < len(lines):
                end += 1  # an array over several lines
            comment = re.search(r"\s+#[^\"]*$", lines[end - 1])
            lines[number - 1 : end] = [line + (comment[0] if comment else "")]
        elif number := found.get(key[:-1]):
            lines.insert(number, line)
        else:
            lines += ["", f"[{'.'.join(map(_key, key[:-1]))}]", line]
        text = "\n".join(lines) + "\n"
    return text


def _is_toml(text: str) -> bool:
    try:
        return bool(tomllib.loads(text))
    except ValueError:
        return False


def _names(dotted: str) -> tuple[str | int, ...]:
    return tuple(name.strip().strip("\"'") for name in dotted.split("."))


def from_document(document: dict[str, Any], kind: type[T], source: str, text: str = "") -> T:
    """Check a parsed document against the dataclass `kind`. text: the file's, where there is one, for the line.

    Raises ConfigurationError with one line.
    """
    try:
        # JSON has TOML's types, and no other way in which to write a number; a tuple carries the configuration to kind
        written = json.dumps([document], default=str)
        return _adapter(kind).validate_json(written, strict=True)[0]
    except ValidationError as error:
        first = error.errors()[0]
        loc, said = first["loc"][1:], first["msg"].removeprefix("Value error, ")
        key = f"key {'.'.join(map(str, loc))}: " if loc else ""
        raise ConfigurationError(one_line(f"{place_of(source, text, loc)}: {key}{said}")) from None
    except (ValueError, RecursionError) as error:  # an integer of thousands of digits cannot be written
        raise ConfigurationError(one_line(f"{source}: {error}")) from None


@cache
def _adapter(kind: type[Any]) -> TypeAdapter[tuple[Any]]:
    """Return what checks a kind: made once, which takes longer than to read a file."""
    return TypeAdapter(tuple[kind], config=_PLAIN)  # pyright: ignore[reportInvalidTypeForm]


def one_line(message: str) -> str:
    """Return a message without its line breaks."""
    return " ".join(message.split())


def toml_text(document: Mapping[str, Any], *comments: str) -> str:
    """Return the text of a TOML file: a line for each comment and each value, and then the tables.

    Values are text, numbers that are finite, booleans, lists of these, and mappings: a table each. A value None is left
    out. tomli-w would write a line for each element of a list. Raises ValueError for a number that is not finite.
    """
    return "\n".join([*(f"# {comment}" for comment in comments), *_table(document, "")]) + "\n"


def _table(values: Mapping[str, Any], path: str) -> Iterator[str]:
    tables = {name: value for name, value in values.items() if isinstance(value, Mapping)}
    for name, value in values.items():
        if name not in tables and value is not None:  # a value is written in JSON as in TOML
            yield f"{_key(name)} = {json.dumps(value, ensure_ascii=False, allow_nan=False)}"
    for name, table in tables.items():
        yield from ("", f"[{path}{_key(name)}]", *_table(table, f"{path}{_key(name)}."))


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


STRICT = ConfigDict(extra="forbid", strict=False, arbitrary_types_allowed=True)
_PLAIN = ConfigDict(extra="forbid", allow_inf_nan=False)  # of dataclasses that have no configuration of their own
