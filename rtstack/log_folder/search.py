"""Search in the list of logs: every word has to be somewhere in what is known of a log.

A word is looked for in the name, the date, the row, and all of the metadata; `key:word` only where the key's name
contains it: seed:3, object:rice, controller:proposed. A range such as force>30 or size<=20 is asked of numbers whose
key's name contains the word before it; a range that asks of nothing that a log has is refused.
"""

import contextlib
import operator
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from rtstack.log.writing.job import values_of
from rtstack.log_folder.catalogue import LogEntry
from rtstack.log_folder.log_rows import LogRow


class FilterRefused(Exception):
    """A filter that means nothing. The message is one line that says what to write, after the parameter's name."""


class Outcome(StrEnum):
    """What came out of a run, for the filter. success: also after an impact that was not meant."""

    ANY = "any"
    SUCCESS = "success"
    UNEXPECTED = "unexpected"
    FAILURE = "failure"
    NONE = "none"


_RANGE = re.compile(r"(?P<key>[a-z0-9_]*)(?P<sign>[<>]=?)(?P<number>.*)")
_SIGNS: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge
}  # fmt: skip
# words of the tables' headings, with the columns that they head; sizes in MB, as they are shown
_HEADED = {
    "shift": "displacement_mm", "force": "average_force_norm", "force_norm": "average_force_norm",
    "lift": "max_lift_mm", "size": "size_mb",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Range:
    """One number that is asked for: force>30. word: as it was written."""

    word: str
    key: str
    holds: Callable[[float, float], bool]
    number: float

    def matches(self, numbers: Sequence[tuple[str, float]]) -> bool | None:
        """Whether one of a log's numbers with such a key is in the range; None where it has none."""
        wanted = _HEADED.get(self.key, self.key)
        exact = [value for key, value in numbers if key == wanted]
        asked = exact or [value for key, value in numbers if wanted in key]
        return any(self.holds(value, self.number) for value in asked) if asked else None


def parsed(query: str) -> tuple[list[str], list[Range]]:
    """Return what a query asks for: words, and ranges of numbers. Raises FilterRefused."""
    words, ranges = [], []
    for word in query.lower().split():
        found = _RANGE.fullmatch(word)
        if found is None:
            words.append(word)
            continue
        try:
            number = float(found["number"])
        except ValueError:
            number = float("nan")
        if not found["key"] or number != number:
            raise FilterRefused(f"q: {word}: a range is a name, a sign and a number without spaces, such as force>30")
        ranges.append(Range(word, found["key"], _SIGNS[found["sign"]], number))
    return words, ranges


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
    STAR = "starred"


def search(pairs: Sequence[tuple[LogEntry, LogRow]], query: str, outcome: Outcome) -> list[LogRow]:
    """Return the rows of the logs that are looked for. Raises FilterRefused, also for a number that no log has."""
    words, ranges = parsed(query)
    known = [(row, _known(entry, row) if query.strip() else []) for entry, row in pairs]
    numbers = [_numbers(values) for _, values in known] if ranges else [[]] * len(known)
    rows = [
        row
        for (row, values), own in zip(known, numbers, strict=True)
        if _came_out(row, outcome) and _has_words(words, values) and all(each.matches(own) for each in ranges)
    ]
    for each in ranges:
        if known and all(each.matches(own) is None for own in numbers):
            raise FilterRefused(
                f"q: {each.word}: no log has a number {each.key}; try force, lift, shift, seed, size (MB)"
            )
    return rows


def _came_out(row: LogRow, outcome: Outcome) -> bool:
    match outcome:
        case Outcome.ANY:
            return True
        case Outcome.UNEXPECTED:
            return row.verdict == "unexpected"
        case _:
            return outcome is {True: Outcome.SUCCESS, False: Outcome.FAILURE, None: Outcome.NONE}[row.success]


def _has_words(words: Sequence[str], known: list[tuple[str, Any]]) -> bool:
    """An underscore may be written as a space or as it is, all in lower case."""
    if not words:
        return True
    texts = [(key, str(value).lower()) for key, value in known]
    texts += [(key, text.replace("_", " ")) for key, text in texts if "_" in text]
    everything = "\n".join(text for _, text in texts)
    return all(_matches(word, texts, everything) for word in words)


def _matches(word: str, known: list[tuple[str, str]], everything: str) -> bool:
    if word in everything:
        return True
    key, colon, wanted = word.partition(":")
    return bool(colon and key) and any(key in name and wanted in text for name, text in known)


def _known(entry: LogEntry, row: LogRow) -> list[tuple[str, Any]]:
    """Key and value of everything that is known of a log."""
    when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(row.when))
    pairs: list[tuple[str, Any]] = [("date", when), ("size_mb", row.size_bytes * 1e-6), *asdict(row).items()]
    for record in (entry.trial, entry.result):
        pairs += (record or {}).items()
        pairs += [inner for value in values_of(record).values() if isinstance(value, dict) for inner in value.items()]
    return [(key.lower(), value) for key, value in pairs if value is not None]


def _numbers(known: Sequence[tuple[str, Any]]) -> list[tuple[str, float]]:
    """Those of them that are numbers, also as text; truth values are none."""
    numbers = []
    for key, value in known:
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            continue
        with contextlib.suppress(ValueError):
            numbers.append((key, float(value)))
    return numbers


def ordered(rows: Sequence[LogRow], key: SortKey, descending: bool) -> list[LogRow]:
    """Return rows in order; those that have no such value are last, either way."""
    having = [row for row in rows if getattr(row, key) is not None]
    without = [row for row in rows if getattr(row, key) is None]
    return sorted(having, key=lambda row: getattr(row, key), reverse=descending) + without
