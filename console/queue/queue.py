"""The queue: entries in order, in a file, and on whose word it runs. It orders nothing: see console.queue.runner."""

import json
import secrets
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from statistics import fmean

from console.orders import TrialOrder
from console.queue.entry import Entry, EntryState, QueueOrder, QueueView
from console.refused import Refused
from rtstack.references.acceptance import keep_beside, load_beside
from rtstack.trials.specification import MOST_SEED

FILE_NAME = "queue.json"
MAX_ENTRIES = 500
INTERRUPTED = "the console ended while it ran"
_FRESH = "not started since the console was started"
_NEW = "it was not started yet"
_EMPTY = "nothing waits in it"
_broken = partial(Refused, 500)


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
