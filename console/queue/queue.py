"""The queue: entries in order, in a file, and on whose word it runs. It orders nothing: see console.queue.runner.

An entry is a trial with its state; a sweep is many of them. Numbers are written as -60:10:60 (first, step, last), as
0:4 (with a step of 1), or one by one: -30, 0; 30.
"""

import json
import math
import secrets
import threading
import time
from collections.abc import Sequence
from dataclasses import MISSING, asdict, dataclass, field, fields, make_dataclass, replace
from enum import StrEnum
from functools import partial
from itertools import product
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any

from pydantic import Field
from pydantic.dataclasses import dataclass as checked

from console.orders import LogId, TrialOrder
from console.refused import Refused
from rtstack.log_folder.log_rows import Ending
from rtstack.messages import MESSAGE, NUMBER, StrictFloat
from rtstack.references.acceptance import keep_beside, load_beside
from rtstack.trials.controllers import DEFAULT, ControllerName
from rtstack.trials.specification import MOST_SEED, MOST_SHIFT_MM, MOST_TURN_DEG, ObjectName, like

MAX_REPETITIONS = 200
MOST_VALUES = 500

# what parses is said by `numbers`, in one line that names the field
Numbers = Annotated[str, Field(min_length=1, max_length=400)]
FILE_NAME = "queue.json"
MAX_ENTRIES = 500
INTERRUPTED = "the console ended while it ran"
_FRESH = "not started since the console was started"
_NEW = "it was not started yet"
_EMPTY = "nothing waits in it"
_broken = partial(Refused, 500)


@checked(frozen=True, slots=True, config=MESSAGE)
class QueueOrder:
    """The same trial so many times, each with the next seed: `seed`, `seed` + 1, ..."""

    trial: TrialOrder
    repetitions: Annotated[int, Field(ge=1, le=MAX_REPETITIONS), NUMBER] = 1


class EntryState(StrEnum):
    """Where an entry is. The last four are final."""

    WAITING = "waiting"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    STOPPED = "stopped"
    CANCELLED = "cancelled"


@checked(frozen=True, slots=True, config=MESSAGE)
class Entry:
    """One trial of the queue. `followed`: what a person calls its reference; `repetition` of the `repetitions` that
    were added together, from 1; job: its number in the robot process, None before it has one; began_s: Unix time;
    duration_s: from the order to both arms at rest; reason: why it did not succeed; log: the id of its log; ending: as
    the list of logs says it.
    """

    id: str
    trial: TrialOrder
    followed: str
    repetition: Annotated[int, NUMBER] = 1
    repetitions: Annotated[int, NUMBER] = 1
    state: EntryState = EntryState.WAITING
    job: Annotated[int, NUMBER] | None = None
    began_s: StrictFloat | None = None
    duration_s: StrictFloat | None = None
    reason: str | None = None
    log: str | None = None
    ending: Ending | None = None

    @property
    def final(self) -> bool:
        """Whether nothing more becomes of it."""
        return self.state not in (EntryState.WAITING, EntryState.RUNNING)


@dataclass(frozen=True, slots=True)
class QueueView:
    """The queue as everybody sees it. `operator`: on whose word it runs, None while it is paused, for this `reason`.

    past_failures: whether it goes on past grabs that do not succeed. time_left_s: from the durations of the trials that
    have ended, None where none has.
    """

    running: bool
    operator: str | None
    reason: str | None
    past_failures: bool
    time_left_s: float | None
    entries: tuple[Entry, ...]


_VARIED = ("object", "controller", "displacement_mm", "displacement_x_mm", "yaw_deg", "seed")
# what all trials of a sweep have in common: every other field of a trial
_SHARED = [each for each in fields(TrialOrder) if each.name not in _VARIED and each.default is not MISSING]
_KEPT = [(each.name, each.type, field(default=each.default)) for each in _SHARED]
_Common: Any = make_dataclass("_Common", _KEPT, kw_only=True, frozen=True, slots=True)


@checked(frozen=True, slots=True, config=MESSAGE)
class SweepOrder(_Common):
    """Each controller with each object at each shift and turn, with each seed; the controllers of a place follow one
    another. Shifts in mm along the world's y and x, turns in degrees about z: numbers such as -60:10:60 or 0, 15.
    """

    reference: LogId
    objects: Annotated[tuple[ObjectName, ...], Field(min_length=1, max_length=32)]
    controllers: Annotated[tuple[ControllerName, ...], Field(min_length=1, max_length=32)] = (DEFAULT,)
    displacements_mm: Numbers = "0"
    displacements_x_mm: Numbers = "0"
    yaws_deg: Numbers = "0"
    seeds: Numbers = "0"

    def trials(self) -> list[TrialOrder]:
        """Return the trials in the order in which they will run. Raises Refused."""
        most = {"displacements_mm": MOST_SHIFT_MM, "displacements_x_mm": MOST_SHIFT_MM, "yaws_deg": MOST_TURN_DEG}
        places = product(*(numbers(name, getattr(self, name), limit) for name, limit in most.items()))
        seeds = whole("seeds", self.seeds)
        combinations = product(dict.fromkeys(self.objects), places, seeds, dict.fromkeys(self.controllers))
        varied = [(thing, controller, *place, seed) for thing, place, seed, controller in combinations]
        return [like(TrialOrder, self, **dict(zip(_VARIED, values, strict=True))) for values in varied]


@dataclass(frozen=True, slots=True)
class SweepSize:
    """How many trials a sweep is, and how many more the queue has room for."""

    trials: int
    room: int


def numbers(field: str, text: str, most: float) -> list[float]:
    """Return the numbers of a text, each once, in its order. Raises Refused with the field's name."""
    found: list[float] = []
    for part in text.replace(";", " ").replace(", ", " ").split():
        found += _range(field, part)
        if len(found) > MOST_VALUES:
            raise Refused(422, f"{field}: {part}: more than {MOST_VALUES} values; take a larger step")
    if not found:
        raise Refused(422, f"{field}: give a number, a list such as -30, 0, 30, or first:step:last such as -60:10:60")
    for value in found:
        if abs(value) > most:
            raise Refused(422, f"{field}: {value:g} is beyond {most:g}")
    return list(dict.fromkeys(found))


def whole(field: str, text: str) -> list[int]:
    """Return the whole numbers of a text that are not negative, as `numbers` does. Raises Refused."""
    values = numbers(field, text, MOST_SEED)
    for value in values:
        if value != int(value) or value < 0:
            raise Refused(422, f"{field}: {value:g}: give whole numbers from 0 on, such as 0:4")
    return [int(value) for value in values]


def _range(field: str, part: str) -> Sequence[float]:
    try:
        values = [float(number) for number in part.split(":")]
    except ValueError:
        values = []
    if not 1 <= len(values) <= 3 or not all(map(math.isfinite, values)):
        raise Refused(422, f'{field}: "{part[:40]}" is not a list: write -12.5, 5 or -60:10:60')
    if len(values) == 1:
        return values
    first, last = values[0], values[-1]
    step = values[1] if len(values) == 3 else 1.0
    if step == 0.0 or (last - first) / step < 0.0:
        raise Refused(422, f"{field}: {part}: steps of {step:g} do not lead from {first:g} to {last:g}")
    steps = math.floor((last - first) / step + 1e-9)
    if steps >= MOST_VALUES:
        raise Refused(422, f"{field}: {part}: more than {MOST_VALUES} values; take a larger step")
    return [round(first + k * step, 9) for k in range(steps + 1)]


class Queue:
    """The list and its file. May be used from any thread; what is changed is kept before a method returns. operator: on
    whose word it runs, None while it is paused, as when the console begins; past_failures: see QueueView.
    """

    def __init__(self, file: Path) -> None:
        """Raises Refused where the file cannot be read."""
        self._file = file
        self._lock = threading.RLock()
        self._entries = list(load_entries(file))
        self.operator: str | None = None
        self.past_failures = False
        self._reason: str | None = _FRESH if self._entries else _EMPTY

    def view(self) -> QueueView:
        """Return how it is now."""
        with self._lock:
            left_s, operator, entries = time_left_s(self._entries, time.time()), self.operator, tuple(self._entries)
            return QueueView(operator is not None, operator, self._reason, self.past_failures, left_s, entries)

    @property
    def room(self) -> int:
        """How many entries there is room for."""
        return MAX_ENTRIES - len(self._entries)

    def add(self, order: QueueOrder, followed: str) -> QueueView:
        """Append an order, one entry a repetition. Raises Refused where there is no room."""
        last = order.trial.seed + order.repetitions - 1
        if last > MOST_SEED:
            raise Refused(409, f"seed: the last repetition would have {last}, beyond {MOST_SEED}; choose a lower one")
        return self.add_all([replace(order.trial, seed=seed) for seed in range(order.trial.seed, last + 1)], followed)

    def add_all(self, trials: Sequence[TrialOrder], followed: str) -> QueueView:
        """Append trials, an entry each. Raises Refused where there is no room for all of them."""
        with self._lock:
            if len(trials) > self.room:
                room = f"these are {len(trials)} trials, and the queue has room for {self.room} more"
                raise Refused(409, f"{room}: clear what is finished, or remove some")
            if self.operator is None and self.next() is None:
                self._reason = _NEW
            numbered = enumerate(trials, start=1)
            added = [Entry(secrets.token_hex(8), trial, followed, k, len(trials)) for k, trial in numbered]
            return self._keep([*self._entries, *added])

    def move(self, entry_id: str, to: int) -> QueueView:
        """Move a waiting entry to a place among those that wait: 0 is next. Raises Refused for any other entry."""
        with self._lock:
            entry = self._waiting(entry_id)
            others = [other for other in self._entries if other.id != entry_id]
            places = [place for place, other in enumerate(others) if other.state is EntryState.WAITING]
            others.insert(places[to] if to < len(places) else len(others), entry)
            return self._keep(others)

    def cancel(self, entry_id: str) -> QueueView:
        """Cancel a waiting entry; it stays in the list. Raises Refused for any other."""
        with self._lock:
            return self._keep(self._changed(self._waiting(entry_id).id, state=EntryState.CANCELLED))

    def remove(self, entry_id: str) -> QueueView:
        """Take an entry off the list. Raises Refused for the one that runs."""
        with self._lock:
            if self.entry(entry_id).state is EntryState.RUNNING:
                raise Refused(409, "it is running: cancel it first")
            return self._keep([entry for entry in self._entries if entry.id != entry_id])

    def clear(self, finished_only: bool) -> QueueView:
        """Take off what is finished, or everything but what runs."""
        with self._lock:
            kept = (EntryState.RUNNING, EntryState.WAITING) if finished_only else (EntryState.RUNNING,)
            return self._keep([entry for entry in self._entries if entry.state in kept])

    def entry(self, entry_id: str) -> Entry:
        """Return an entry. Raises Refused."""
        with self._lock:
            for entry in self._entries:
                if entry.id == entry_id:
                    return entry
        raise Refused(404, "there is no such entry in the queue; look at the list again")

    def start(self, operator: str, past_failures: bool) -> None:
        """Let it run on this operator's word. Raises Refused where nothing waits, or it runs on another's."""
        with self._lock:
            if self.operator not in (None, operator):
                raise Refused(409, f"it runs on the word of {self.operator}; pause it first")
            if self.next() is None:
                raise Refused(409, "nothing waits in the queue; add a trial first")
            self.operator, self.past_failures, self._reason = operator, past_failures, None

    def pause(self, reason: str) -> None:
        """Start nothing more; what runs goes on to its end. The first reason stays."""
        with self._lock:
            if self.operator is not None:
                self.operator, self._reason = None, reason

    def running(self) -> Entry | None:
        """Return the entry that runs."""
        return self.next(EntryState.RUNNING)

    def next(self, state: EntryState = EntryState.WAITING) -> Entry | None:
        """Return the first entry in this state: the one whose turn it is."""
        with self._lock:
            return next((entry for entry in self._entries if entry.state is state), None)

    def claim(self, entry_id: str, operator: str) -> bool:
        """Mark an entry as running before it is ordered; False where it was changed or paused meanwhile."""
        with self._lock:
            entry = self.next()
            if self.operator != operator or entry is None or entry.id != entry_id:
                return False
            self._keep(self._changed(entry_id, state=EntryState.RUNNING, began_s=time.time()))
            return True

    def note(self, entry_id: str, **changes: object) -> None:
        """Note what has become of an entry: known from now on, also where Refused says that it is not kept."""
        with self._lock:
            self._entries = self._changed(entry_id, **changes)
            save_entries(self._file, self._entries)

    def _changed(self, entry_id: str, **changes: object) -> list[Entry]:
        return [replace(e, **changes) if e.id == entry_id else e for e in self._entries]  # type: ignore[arg-type]

    def _waiting(self, entry_id: str) -> Entry:
        entry = self.entry(entry_id)
        if entry.state is not EntryState.WAITING:
            raise Refused(409, f"it is {entry.state}: only what waits can be moved or cancelled")
        return entry

    def _keep(self, entries: list[Entry]) -> QueueView:
        save_entries(self._file, entries)
        self._entries = entries
        return self.view()


def load_entries(path: Path) -> tuple[Entry, ...]:
    """Return the entries, none where there is no file; what ran is stopped. Raises Refused."""
    return tuple(
        replace(entry, state=EntryState.STOPPED, reason=INTERRUPTED) if entry.state is EntryState.RUNNING else entry
        for entry in load_beside(path, tuple[Entry, ...], _broken, "to begin with an empty queue")
    )


def save_entries(path: Path, entries: Sequence[Entry]) -> None:
    """Keep the entries. Raises Refused."""
    keep_beside(path, json.dumps([asdict(entry) for entry in entries], indent=1), _broken)


def time_left_s(entries: Sequence[Entry], now_s: float) -> float | None:
    """Return how long what waits and runs will take, s: the mean of what has ended, of the same reference if any."""
    measured = [e for e in entries if e.duration_s is not None and e.state is not EntryState.STOPPED]
    left = 0.0
    for entry in (each for each in entries if not each.final):
        same = [e for e in measured if e.trial.reference == entry.trial.reference] or measured
        if not same:
            return None
        expected = fmean(e.duration_s for e in same if e.duration_s is not None)
        left += max(0.0, expected - (now_s - entry.began_s)) if entry.began_s is not None else expected
    return left
