"""The logs as the review's routes use them: looked up by their opaque ids, with their columns and pictures."""

import re
import time
from bisect import bisect_right
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from console.refused import Refused
from console.review.cache import ReviewCache
from console.review.columns import LogColumns
from rtstack.log.analysis.signals import Signal, signals
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.log_folder.catalogue import Catalogue, LogCondition, LogEntry

MAX_SIGNALS = 64
_IMAGES = re.compile(r"/camera/(\w+)/image")
_QUIET_S = 3.0  # a log that grows is flushed every 0.25 s


@dataclass(frozen=True, slots=True)
class ReadLog(LogColumns):
    """A log whose reading has begun."""

    entry: LogEntry


def listed(catalogue: Catalogue, log_id: str, none: str = "This log does not exist.") -> LogEntry:
    """Return the log of an id, never of a path. Raises Refused with the line `none`."""
    try:
        return catalogue.entry(log_id)
    except LogError:
        raise Refused(404, none) from None


def entry_of(catalogue: Catalogue, log_id: str) -> LogEntry:
    """Return the log of an id for the review. Raises Refused."""
    entry = listed(catalogue, log_id)
    if entry.condition is LogCondition.FOREIGN:
        raise Refused(422, "This file is not a log of rtstack: it can be downloaded, not reviewed.")
    return entry


def opened(catalogue: Catalogue, cache: ReviewCache, log_id: str) -> ReadLog | None:
    """Return the log of an id with its columns, None while it waits to be read. Raises Refused."""
    known = cache.reopened(log_id)
    return opened_entry(entry_of(catalogue, log_id), cache) if known is None else _readable(*known)


def begun(catalogue: Catalogue, cache: ReviewCache, log_id: str) -> ReadLog:
    """Return a log of which something has been read. Raises Refused."""
    log = opened(catalogue, cache, log_id)
    if log is None:
        raise Refused(409, "nothing of this log has been read yet: ask for /api/logs/ID until `share` grows")
    return log


def opened_entry(entry: LogEntry, cache: ReviewCache) -> ReadLog | None:
    """Return a log that has been looked up already, like `opened`."""
    if growing(entry):
        raise Refused(409, "this log is being written: it can be reviewed once its run has ended")
    return _readable(entry, cache.open(entry))


def growing(entry: LogEntry) -> bool:
    """Whether a log is being written."""
    return entry.condition is LogCondition.TRUNCATED and time.time() - entry.modified_s < _QUIET_S


def _readable(entry: LogEntry, columns: LogColumns | None) -> ReadLog | None:
    if columns is None:
        return None
    if columns.index.error is not None:
        raise Refused(422, f"this log cannot be read: {columns.index.error}")
    return ReadLog(columns.folder, columns.index, entry)


def wanted_signals(names: str, *logs: LogColumns) -> list[Signal]:
    """Return the signals of a list of names, separated by commas. Raises Refused for one that no log has."""
    known = signals() | {name: signal for log in logs for name, signal in log.index.signals.items()}
    wanted = [name for name in dict.fromkeys(names.split(",")) if name]
    for name in wanted:
        if name not in known:
            raise Refused(422, f"signals: there is no signal {name[:80]}")
    if len(wanted) > MAX_SIGNALS:
        raise Refused(422, f"signals: {len(wanted)} are too many at once, at most {MAX_SIGNALS}")
    return [known[name] for name in wanted]


@lru_cache(maxsize=4)
def _pictures(path: Path, _size_bytes: int, _modified_s: float) -> tuple[Log, dict[str, list[int]]]:
    log = read_log(path, truncated=True)
    names = {found[1]: topic for topic in log.topics if (found := _IMAGES.fullmatch(topic))}
    return log, {name: times for name, topic in names.items() if (times := log.times(topic))}


def picture_times(entry: LogEntry, start_ns: int) -> dict[str, list[float]]:
    """Return when each camera has a picture, s since start_ns, by its name. Raises LogError."""
    known = _pictures(entry.path, entry.size_bytes, entry.modified_s)[1]
    return {name: [round((t_ns - start_ns) * 1e-9, 9) for t_ns in times] for name, times in known.items()}


def picture_at(entry: LogEntry, camera: str, t_ns: int) -> bytes | None:
    """Return the newest picture at a moment, or the first one; None where there is no such camera. Raises LogError."""
    log, known = _pictures(entry.path, entry.size_bytes, entry.modified_s)
    if (times := known.get(camera)) is None:
        return None
    at_ns = times[max(0, bisect_right(times, t_ns) - 1)]
    shown = log.pictures(f"/camera/{camera}/image", (at_ns, at_ns))
    return shown[0][1] if shown else None  # a part of H.264 that cannot be decoded
