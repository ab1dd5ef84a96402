"""What was different between two logs: what was asked, the versions, the host, the cell's description."""

import json
import tomllib
from typing import Any

from rtstack.log.reader import Log

_CELL = "cell.toml"


def settings(log: Log) -> dict[str, str]:
    """Return everything that was set for a log's run, by dotted key: trial.seed, cell.pad.size."""
    flat: dict[str, str] = {}
    _flatten("trial", {key: _parsed(text) for key, text in log.metadata.get("trial", {}).items()}, flat)
    for attachment in log.attachments:
        if attachment.name == _CELL:
            try:
                _flatten("cell", tomllib.loads(attachment.data.decode()), flat)
            except ValueError:
                flat["cell"] = "not readable"
    return flat


def differences(left: Log, right: Log) -> list[tuple[str, str | None, str | None]]:
    """Return (key, value of the one, value of the other) wherever they differ; None: not set."""
    ours, others = settings(left), settings(right)
    keys = [*ours, *(key for key in others if key not in ours)]
    return [(key, ours.get(key), others.get(key)) for key in keys if ours.get(key) != others.get(key)]


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _flatten(prefix: str, value: Any, flat: dict[str, str]) -> None:
    if isinstance(value, dict):
        for key, inner in value.items():
            _flatten(f"{prefix}.{key}", inner, flat)
    else:
        flat[prefix] = value if isinstance(value, str) else json.dumps(value, default=str)
