"""Search in the list of logs: every word has to be somewhere in what is known of a log.

A word is looked for in the name, the date, the row, and all of the metadata; `key:word` only where the key's name
contains it: seed:3, object:rice, controller:proposed.
"""

import json
import time
from collections.abc import Sequence
from dataclasses import asdict
from enum import StrEnum
from typing import Any

from console.log_rows import LogRow
from rtstack.log.catalogue import LogEntry


class Outcome(StrEnum):
    """What came out of a run, for the filter."""

    ANY = "any"
    SUCCESS = "success"
    FAILURE = "failure"
    NONE = "none"


class SortKey(StrEnum):
    """What the list can be sorted by."""

    WHEN = "when"
    NAME = "name"
    KIND = "kind"
    CONTROLLER = "controller"
    OBJECT = "object"
    DISPLACEMENT = "displacement_mm"
    SEED = "seed"
    OUTCOME = "outcome"
    VERDICT = "verdict"
    FORCE = "average_force_norm"
    LIFT = "max_lift_mm"
    SIZE = "size_bytes"


def found(entry: LogEntry, row: LogRow, query: str, outcome: Outcome) -> bool:
    """Whether a log is among those that are looked for."""
    succeeded = {True: Outcome.SUCCESS, False: Outcome.FAILURE, None: Outcome.NONE}[row.success]
    if outcome not in (Outcome.ANY, succeeded):
        return False
    words = query.lower().split()
    if not words:
        return True
    known = _known(entry, row)
    everything = "\n".join(text for _, text in known)
    return all(_matches(word, known, everything) for word in words)


def _matches(word: str, known: list[tuple[str, str]], everything: str) -> bool:
    if word in everything:
        return True
    key, colon, wanted = word.partition(":")
    return bool(colon and key) and any(key in name and wanted in text for name, text in known)


def _known(entry: LogEntry, row: LogRow) -> list[tuple[str, str]]:
    """Key and text, lower case, of everything; an underscore may be written as a space or as it is."""
    when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(row.when))
    pairs: list[tuple[str, Any]] = [("date", when), *asdict(row).items()]
    for record in (entry.trial, entry.result):
        for key, text in (record or {}).items():
            pairs += [(key, text), *_inside(text)]
    lowered = [(key.lower(), str(value).lower()) for key, value in pairs if value is not None]
    return [*lowered, *((key, text.replace("_", " ")) for key, text in lowered if "_" in text)]


def _inside(text: str) -> list[tuple[str, Any]]:
    try:
        value = json.loads(text)
    except ValueError:
        return []
    return list(value.items()) if isinstance(value, dict) else []


def ordered(rows: Sequence[LogRow], key: SortKey, descending: bool) -> list[LogRow]:
    """Return rows in order; those that have no such value are last, either way."""
    having = [row for row in rows if getattr(row, key) is not None]
    without = [row for row in rows if getattr(row, key) is None]
    return sorted(having, key=lambda row: getattr(row, key), reverse=descending) + without
