"""Search in the list of logs: every word has to be somewhere in what is known of a log.

A word is looked for in the name, the date, the row, and all of the metadata; `key:word` only where the key's name
contains it: seed:3. `key=value` needs the whole value of exactly that key: object=rice_box. A range such as force>30 is
asked of numbers whose key's name contains the word before it, and refused where no log has one. date>=2026-11-26T08:00
is UTC, by the log's own time of day; date<=2026-11-26 includes that day. "two words" in quotes are one.
"""

import contextlib
import operator
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from enum import StrEnum
from functools import cached_property, lru_cache
from sys import intern
from typing import Any

from rtstack.log.writing.job import values_of
from rtstack.log_folder.catalogue import LogEntry
from rtstack.log_folder.log_rows import LogRow
from rtstack.log_folder.remarks import EpisodeVerdict


class FilterRefused(Exception):
    """A filter that means nothing. The message is one line that says what to write, after the parameter's name."""


class Outcome(StrEnum):
    """What came out of a run, for the filter. success: also after an impact that was not meant."""

    ANY = "any"
    SUCCESS = "success"
    UNEXPECTED = "unexpected"
    FAILURE = "failure"
    NONE = "none"


_CAME_OUT = {True: Outcome.SUCCESS, False: Outcome.FAILURE, None: Outcome.NONE}
DATE = "recorded_utc"  # the key of the time of day that a log has, UTC
_WORD = re.compile(r'(?:[^\s"]|"[^"]*"?)+')  # "two words" are one
_DAY, _DAY_S = re.compile(r"\d{4}-\d\d-\d\d"), 86_400.0
_CONDITION = re.compile(r"(?P<key>[a-z0-9_]*)(?P<sign>[<>]=?|=)(?P<value>.*)")
_SIGNS: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "=": operator.eq
}  # fmt: skip
# words of the tables' headings, with the columns that they head; sizes in MB, as they are shown
_HEADED = {
    "shift": "displacement_mm", "force": "average_force_norm", "force_norm": "average_force_norm",
    "lift": "max_lift_mm", "size": "size_mb", "date": DATE,
}  # fmt: skip
_COLUMNS = tuple(field.name for field in fields(LogRow))
_SAME = {"verdict": ("verdict", "episode_verdict"), "tags": ("tag",)}  # keys that one word asks for


def success_of(row: LogRow) -> bool | None:
    """Return whether a run has succeeded, None where nothing says it: what a person called failed has not."""
    return False if row.episode_verdict is EpisodeVerdict.FAILED else row.success


@dataclass(frozen=True)
class Facts:
    """Key, in lower case, and value of everything that is known of a log."""

    pairs: tuple[tuple[str, Any], ...]

    @classmethod
    def of(cls, entry: LogEntry, row: LogRow) -> "Facts":
        when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(row.when))
        pairs: list[tuple[str, Any]] = [("date", when), ("size_mb", row.size_bytes * 1e-6), (DATE, entry.recorded)]
        shown = {name: getattr(row, name) for name in _COLUMNS} | {"success": success_of(row)}
        pairs += [*shown.items(), *(("tag", tag) for tag in row.tags)]
        recorded, own = _recorded(entry), cls(tuple((key, value) for key, value in pairs if value is not None))
        both = cls(own.pairs + recorded.pairs)
        both.__dict__.update(texts=own.texts + recorded.texts, numbers=own.numbers + recorded.numbers)
        return both

    @cached_property
    def texts(self) -> tuple[tuple[str, str], ...]:
        """All values as texts in lower case; one with underscores a second time, with spaces."""
        texts = [(key, str(value).lower()) for key, value in self.pairs]
        return *texts, *((key, text.replace("_", " ")) for key, text in texts if "_" in text)

    @cached_property
    def numbers(self) -> tuple[tuple[str, float], ...]:
        """Those of them that are numbers, also as text; truth values are none. The date is Unix time, s."""
        numbers = []
        for key, value in self.pairs:  # the text of a truth value or of a list is no number
            with contextlib.suppress(ValueError):
                numbers.append((key, _number(key, str(value))))
        return tuple(numbers)


@lru_cache(maxsize=20_000)
def _recorded(entry: LogEntry) -> Facts:
    """Return what a log's metadata say. Kept, and texts that logs share are kept once: a list has thousands."""
    pairs: list[tuple[str, Any]] = []
    for record in (entry.trial, entry.result):
        pairs += ((key, value) for key, value in (record or {}).items() if key != "success")
        nested = [value for value in values_of(record).values() if isinstance(value, dict)]
        pairs += [inner for value in nested for inner in value.items()]
    return Facts(tuple((intern(key.lower()), intern(str(value))) for key, value in pairs if value is not None))


def _number(key: str, text: str) -> float:
    """Return a number as it is written; of the date, UTC, the Unix time, s. Raises ValueError."""
    if key != DATE:
        return float(text)
    found = datetime.fromisoformat(text.upper())
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


@dataclass(frozen=True, slots=True)
class Condition:
    """What a log has to have: a word as it was written, or (sign) a value of a key. number: of value, or NaN."""

    word: str
    key: str = ""
    sign: str = ""
    value: str = ""
    number: float = float("nan")

    @property
    def is_range(self) -> bool:
        return self.sign not in ("", "=")

    def values(self, facts: Facts) -> list[Any]:
        """Return what a log has of the key: numbers for a range, else texts."""
        wanted = _HEADED.get(self.key, self.key)
        if self.is_range:
            exact = [number for key, number in facts.numbers if key == wanted]
            return exact or [number for key, number in facts.numbers if wanted in key]
        return [str(value).lower() for key, value in facts.pairs if key in _SAME.get(wanted, (wanted,))]

    def lacking(self, facts: Facts) -> str | None:
        """Return in words why a log does not meet this, None where it does."""
        if not self.sign:
            key, colon, wanted = self.word.partition(":")
            found = any(self.word in text or (colon and key and key in name and wanted in text)
                        for name, text in facts.texts)  # fmt: skip
            return None if found else f"it has no {self.word}"
        values = self.values(facts)
        if any(_SIGNS[self.sign](each, self.number) if self.is_range else self._is(each) for each in values):
            return None
        shown = [text for key, text in facts.texts if key == DATE] if self.key == "date" else map(str, values)
        said = ", ".join(dict.fromkeys(shown))
        name = "time of day" if self.key == "date" else self.key
        return f"{name} is {said}, not {self.word[len(self.key) :].removeprefix('=')}" if said else f"it has no {name}"

    def _is(self, text: str) -> bool:
        if self.key == "date":
            return text.startswith(self.value)  # of a day, or an hour
        with contextlib.suppress(ValueError):
            return float(text) == self.number
        return text.replace("_", " ") == self.value.replace("_", " ")


def parsed(query: str) -> list[Condition]:
    """Return what a query asks for. Raises FilterRefused."""
    conditions = []
    for word in (found.replace('"', "") for found in _WORD.findall(query.lower())):
        found = _CONDITION.fullmatch(word)
        if found is None:
            conditions.append(Condition(word))
            continue
        key, sign, number = found["key"], found["sign"], float("nan")
        with contextlib.suppress(ValueError):
            number = _number(_HEADED.get(key, key), found["value"])
        if sign in ("<=", ">") and _DAY.fullmatch(found["value"]):
            number += _DAY_S - 1e-6  # a day has ended where the next one begins
        if not key or not found["value"] or (sign != "=" and number != number):
            text = "a range is a name, a sign and a number without spaces, such as force>30 or date>=2026-11-26T08:30"
            raise FilterRefused(f"q: {word}: {text}")
        conditions.append(Condition(word, key, sign, found["value"], number))
    return conditions


class SortKey(StrEnum):
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
    conditions = parsed(query)
    known = [(row, Facts.of(entry, row) if conditions else Facts(())) for entry, row in pairs]
    for each in conditions:
        if each.is_range and known and each.key != "date" and not any(each.values(facts) for _, facts in known):
            text = f"no log has a number {each.key}; try force, lift, shift, seed, size (MB)"
            raise FilterRefused(f"q: {each.word}: {text}")
    return [row for row, facts in known
            if outcome in (Outcome.ANY, _CAME_OUT[row.success]) or outcome == row.verdict == Outcome.UNEXPECTED
            if all(each.lacking(facts) is None for each in conditions)]  # fmt: skip


def ordered(rows: Sequence[LogRow], key: SortKey, descending: bool) -> list[LogRow]:
    """Return rows in order; those that have no such value are last, either way."""
    having = [row for row in rows if getattr(row, key) is not None]
    without = [row for row in rows if getattr(row, key) is None]
    return sorted(having, key=operator.attrgetter(key), reverse=descending) + without
