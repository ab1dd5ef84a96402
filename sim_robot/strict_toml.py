"""TOML tables into frozen dataclasses, strictly: every key is expected, present and of its type."""

import math
import tomllib
import types
import typing
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

Record = TypeVar("Record")


class BadParameterFile(ValueError):
    """A scene or parameter file has a wrong key or value. The message names the file and the key."""


def read_record(kind: type[Record], path: Path) -> Record:
    """Read the file at `path` into the dataclass `kind`. Raises BadParameterFile, OSError without a file."""
    return record_from_table(kind, read_table(path), str(path))


def read_table(path: Path) -> dict[str, Any]:
    """Read the file at `path`. Raises BadParameterFile, OSError without a file."""
    try:
        with path.open("rb") as file:
            return tomllib.load(file)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadParameterFile(f"{path}: not valid TOML: {error}") from error


def record_from_table(kind: type[Record], table: Any, where: str) -> Record:
    """Return the dataclass `kind` filled from `table`. Raises BadParameterFile.

    Field types: float, int, str, bool, another dataclass, tuple[X, ...] or tuple of a fixed length, dict[str,
    X], X | None. An integer is taken for a float, nothing else is converted; floats are finite. A field that has a
    default may be missing.
    """
    if not isinstance(table, dict):
        raise BadParameterFile(f"{where}: expected a table, got {table!r}")
    kinds = typing.get_type_hints(kind)
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    for key in table:
        if key not in names:
            raise BadParameterFile(f"{where}: unknown key '{key}'; known keys: {', '.join(names)}")
    for field in fields(kind):  # type: ignore[arg-type]
        if field.name not in table and field.default is MISSING:
            raise BadParameterFile(f"{where}: missing key '{field.name}'")
    values = {name: _value(kinds[name], value, f"{where}: {name}") for name, value in table.items()}
    try:
        return kind(**values)
    except ValueError as error:
        raise BadParameterFile(f"{where}: {error}") from error


def _value(kind: Any, value: Any, where: str) -> Any:
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is types.UnionType:  # of a record and None, which TOML cannot say
        return _value(arguments[0], value, where)
    if is_dataclass(kind):
        return record_from_table(kind, value, where)  # type: ignore[arg-type]
    if origin is dict:
        if not isinstance(value, dict):
            raise BadParameterFile(f"{where}: expected a table, got {value!r}")
        return {key: _value(arguments[1], item, f"{where}.{key}") for key, item in value.items()}
    if origin is tuple:
        if not isinstance(value, list):
            raise BadParameterFile(f"{where}: expected a list, got {value!r}")
        kinds = [arguments[0]] * len(value) if arguments[-1] is Ellipsis else list(arguments)
        if len(kinds) != len(value):
            raise BadParameterFile(f"{where}: expected {len(kinds)} values, got {len(value)}")
        return tuple(_value(k, v, f"{where}[{i}]") for i, (k, v) in enumerate(zip(kinds, value, strict=True)))
    if kind is float and type(value) in (int, float):
        if not math.isfinite(value):
            raise BadParameterFile(f"{where}: expected a finite number, got {value!r}")
        return float(value)
    if type(value) is not kind:
        raise BadParameterFile(f"{where}: expected {kind.__name__}, got {value!r}")
    return value
