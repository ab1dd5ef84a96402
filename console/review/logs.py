"""The logs as the review's routes use them: looked up by their opaque ids, with their columns."""

import time
from dataclasses import dataclass
from pathlib import Path

from console.review.cache import Opened, ReviewCache
from console.review.columns import Index
from rtstack.log.catalogue import Catalogue, LogCondition, LogEntry
from rtstack.log.errors import LogError
from rtstack.log.signals import Signal, signals

MAX_SIGNALS = 64
_QUIET_S = 3.0  # a log that grows is flushed every 0.25 s


class NotReviewable(Exception):
    """A log that is not there, cannot be read, or a question that it has no answer to. `status` as in HTTP."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status


@dataclass(frozen=True, slots=True)
class ReadLog:
    """A log whose reading has begun. index: as far as it is."""

    entry: LogEntry
    folder: Path
    index: Index


def entry_of(catalogue: Catalogue, log_id: str) -> LogEntry:
    """Return the log of an id, never of a path. Raises NotReviewable."""
    try:
        entry = catalogue.entry(log_id)
    except LogError as error:
        raise NotReviewable(404, "there is no such log; reload the list") from error
    if entry.condition is LogCondition.FOREIGN:
        raise NotReviewable(422, "this file is no log of ours: it can be downloaded, not reviewed")
    return entry


def opened(catalogue: Catalogue, cache: ReviewCache, log_id: str) -> ReadLog | None:
    """Return the log of an id with its columns, None while it waits to be read. Raises NotReviewable."""
    known = cache.reopened(log_id)
    return opened_entry(entry_of(catalogue, log_id), cache) if known is None else _readable(*known)


def opened_entry(entry: LogEntry, cache: ReviewCache) -> ReadLog | None:
    """Return a log that has been looked up already, like `opened`."""
    if entry.condition is LogCondition.TRUNCATED and time.time() - entry.modified_s < _QUIET_S:
        raise NotReviewable(409, "this log is being written: it can be reviewed once its run has ended")
    return _readable(entry, cache.open(entry))


def _readable(entry: LogEntry, columns: Opened) -> ReadLog | None:
    if columns.index is None:
        return None
    if columns.index.error is not None:
        raise NotReviewable(422, f"this log cannot be read: {columns.index.error}")
    return ReadLog(entry, columns.folder, columns.index)


def wanted_signals(names: str) -> list[Signal]:
    """Return the signals of a list of names, separated by commas. Raises NotReviewable for one that there is not."""
    known = signals()
    wanted = [name for name in dict.fromkeys(names.split(",")) if name]
    for name in wanted:
        if name not in known:
            raise NotReviewable(422, f"signals: there is no signal {name[:80]}")
    if len(wanted) > MAX_SIGNALS:
        raise NotReviewable(422, f"signals: {len(wanted)} are too many at once, at most {MAX_SIGNALS}")
    return [known[name] for name in wanted]


def read_share(log: ReadLog | None) -> float:
    """Return how much of a log has been read, 0 to 1."""
    return 0.0 if log is None else log.index.share
