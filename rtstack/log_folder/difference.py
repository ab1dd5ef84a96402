"""What was different between logs: what was asked, the versions, the host, the cell's description."""

import json
import tomllib
from collections.abc import Sequence
from typing import Any

from rtstack.log.reader import Log
from rtstack.log.writing.job import values_of

_ASKED = "trial.specification."


def settings(log: Log) -> dict[str, str]:
    """Return everything that was set for a log's run, by dotted key: trial.seed, cell.pad.size."""
    flat: dict[str, str] = {}
    _flatten("trial", values_of(log.metadata.get("trial")), flat)
    if (cell := log.attachment("cell.toml")) is not None:
        try:
            _flatten("cell", tomllib.loads(cell.decode()), flat)
        except ValueError:
            flat["cell"] = "not readable"
    return flat


def differences(logs: Sequence[Log]) -> list[tuple[str, tuple[str | None, ...]]]:
    """Return (key, its value in each log) wherever they differ, what was asked first; None: not set."""
    of_each = [settings(log) for log in logs]
    keys = dict.fromkeys(key for one in of_each for key in one)
    rows = [(key, tuple(one.get(key) for one in of_each)) for key in keys]
    return sorted([row for row in rows if len(set(row[1])) > 1], key=lambda row: not row[0].startswith(_ASKED))


def _flatten(prefix: str, value: Any, flat: dict[str, str]) -> None:
    if isinstance(value, dict):
        for key, inner in value.items():
            _flatten(f"{prefix}.{key}", inner, flat)
    else:
        flat[prefix] = value if isinstance(value, str) else json.dumps(value, default=str)
