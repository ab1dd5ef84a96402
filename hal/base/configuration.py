"""TOML into frozen dataclasses, and back: an unknown, missing or ill-typed key is one line with its name and place.

Values are taken as they are written: neither a text nor true is a number. A list becomes a tuple, an integer may stand
for a float. The floats of a dataclass without a configuration of its own are finite.
"""

import json
import math
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

LARGEST_FILE = 4_000_000  # bytes: a person's file has thousands
_MOST_PARTS = 32  # of a dotted key, and of a document's depth
_PART = r"""(?:(?<![\w-])[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*"""
_NESTED = re.compile(rf"(?:{_PART}){{{_MOST_PARTS}}}")
_LONGEST = 200  # letters of a value in a message


class ConfigurationError(Exception):
    """A configuration that cannot be used. The message names the file, the key and what is wrong with it."""


def load_toml(path: Path, kind: type[T]) -> T:
    """Read `path` into the dataclass `kind`. Raises ConfigurationError with one line."""
    document, text = read_toml(path)
    return from_document(document, kind, str(path), text)


def read_file(path: Path) -> str:
    """Return a configuration's text, UTF-8, without a byte order mark. Raises OSError, ValueError."""
    with path.open("rb") as file:
        data = file.read(LARGEST_FILE + 1)
    if len(data) > LARGEST_FILE:
        raise ValueError(f"it is larger than {LARGEST_FILE // 1_000_000} MB, expected a file that people write")
    return data.decode("utf-8-sig").replace("\r\n", "\n")


def read_toml(path: Path) -> tuple[dict[str, Any], str]:
    """Return what a file says, parsed and as text. Raises ConfigurationError with one line."""
    text = ""
    try:
        text = read_file(path)
        if found := _NESTED.search(text):  # before the parser, whose time and memory grow with the square of it
            line = text.count("\n", 0, found.start()) + 1
            raise ValueError(f"a key has more than {_MOST_PARTS} parts (at line {line}, column 1)")
        return tomllib.loads(text), text
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:  # a path with a NUL or a number of thousands of digits: ValueError
        found = re.search(r" \(at line (\d+), column \d+\)", str(error))
        place = f"{path}:{found[1]}" if found else str(path)
        hint = _comma(text, int(found[1])) if found else ""
        raise ConfigurationError(one_line(f"{place}: not valid TOML: {error}{hint}")) from None


def _comma(text: str, line: int) -> str:
    """Return what to do where a line seems to have a decimal comma, else an empty text."""
    found = re.search(r"(?<![\w.])-?\d+,\d+", "".join(text.splitlines()[line - 1 : line]))
    return f"; {found[0]} has a decimal comma: write {found[0].replace(',', '.')}" if found else ""


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
    """Return a TOML file's text with other values of some keys, by the names of table and key; everything else stays.

    A key that is not there comes below its table's name, a table at the end.
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
    """Check a parsed document against `kind`. text: for the line. Raises ConfigurationError with one line."""
    for loc, number in _numbers(document, ()):
        if (isinstance(number, int) and number.bit_length() > 64) or not abs(number) < math.inf:
            found = number if isinstance(number, float) else f"a number of {number.bit_length() * 0.301:.0f} digits"
            place, key = place_of(source, text, loc), ".".join(map(str, loc))
            raise ConfigurationError(one_line(f"{place}: key {key}: Input should be a finite number, found {found}"))
    try:
        # JSON has TOML's types, and no other way in which to write a number; a tuple carries the configuration to kind
        return _adapter(kind).validate_json(json.dumps([document], default=str), strict=True)[0]
    except ValidationError as error:
        first = error.errors()[0]
        loc, said = first["loc"][1:], first["msg"].removeprefix("Value error, ")
        key = f"key {'.'.join(map(str, loc))}: " if loc else ""
        place, value = place_of(source, text, loc), first["input"]
        found = f", found {shortened(repr(value))}" if isinstance(value, str | int | float) else ""
        hint = _comma(text, int(place.rpartition(":")[2])) if "items" in said and place != source else ""
        raise ConfigurationError(one_line(f"{place}: {key}{said}{found}{hint}")) from None
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(one_line(f"{source}: {error}")) from None


@cache
def _adapter(kind: type[Any]) -> TypeAdapter[tuple[Any]]:
    """Return what checks a kind: made once, which takes longer than to read a file."""
    return TypeAdapter(tuple[kind], config=_PLAIN)  # pyright: ignore[reportInvalidTypeForm]


def _numbers(value: Any, key: tuple[str | int, ...]) -> Iterator[tuple[tuple[str | int, ...], float | int]]:
    """Yield the numbers of a document, with their keys."""
    if isinstance(value, dict | list):
        for name, each in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _numbers(each, (*key, name))
    elif isinstance(value, float | int):
        yield key, value


def shortened(text: str) -> str:
    """Return a text with the middle left out, where it is too long for a message."""
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST // 2]}...{text[-20:]}"


def one_line(message: str) -> str:
    """Return a message without its line breaks, each long word shortened."""
    return " ".join(map(shortened, message.split()))


def toml_text(document: Mapping[str, Any], *comments: str) -> str:
    """Return the text of a TOML file: a line for each comment and each value (text, finite numbers, booleans, lists;
    None is left out), and then a table for each mapping.

    tomli-w would write a line for each element of a list. Raises ValueError for a number that is not finite.
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
"""The configuration of a pydantic dataclass that a file is read into: an unknown key is an error."""
_PLAIN = ConfigDict(extra="forbid", allow_inf_nan=False)  # of dataclasses that have no configuration of their own
