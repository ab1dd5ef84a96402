"""The pictures of a log's cameras, as the review asks for them: when there are some, and the one at a moment."""

import re
from bisect import bisect_right
from functools import lru_cache
from pathlib import Path

from rtstack.log.catalogue import LogEntry
from rtstack.log.reader import Log, read_log

_TOPIC = re.compile(r"/camera/(\w+)/image")


@lru_cache(maxsize=4)
def _log(path: Path, _size_bytes: int, _modified_s: float) -> tuple[Log, dict[str, list[int]]]:
    log = read_log(path, truncated=True)
    names = {found[1]: topic for topic in log.topics if (found := _TOPIC.fullmatch(topic))}
    return log, {name: times for name, topic in names.items() if (times := log.times(topic))}


def _known(entry: LogEntry) -> tuple[Log, dict[str, list[int]]]:
    return _log(entry.path, entry.size_bytes, entry.modified_s)


def picture_times(entry: LogEntry, start_ns: int) -> dict[str, list[float]]:
    """Return when each camera has a picture, s since start_ns, by its name. Raises LogError."""
    return {name: [round((t_ns - start_ns) * 1e-9, 9) for t_ns in times] for name, times in _known(entry)[1].items()}


def picture_at(entry: LogEntry, camera: str, t_ns: int) -> bytes | None:
    """Return the newest picture at a moment, or the first one; None where there is no such camera. Raises LogError."""
    log, known = _known(entry)
    times = known.get(camera)
    if not times:
        return None
    at_ns = times[max(0, bisect_right(times, t_ns) - 1)]
    shown = log.pictures(f"/camera/{camera}/image", (at_ns, at_ns))
    return shown[0][1] if shown else None  # a part of H.264 that cannot be decoded
