"""The log of a log process that was killed, made whole: what it had written, then what the rings still hold."""

from collections import defaultdict
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import NonSeekingReader
from numpy.typing import NDArray

from hal.base.files import replacing
from rtstack.log.ring import Rings
from rtstack.log.writing.job import Evidence, LogJob
from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.topics import TICK_TOPICS, TOPICS

_AT_ONCE = 10_000  # messages: some MB
_NEXT_NS = 1_500_000  # the next tick comes before


def make_whole(
    path: Path, rings: Rings, job: LogJob, ended: str, result: dict[str, str], evidence: Evidence | None
) -> tuple[int, float]:
    """Replace a log that was cut off, as `ended` says, by one with the rings' newer samples, a result and a fault's
    evidence.

    Return the number of messages, and how much is missing between both, s; then the run has failed. Raises OSError:
    then the file stays as it was.
    """
    last_ns, seen = -1, dict.fromkeys(TOPICS, 0)
    with replacing(path) as new, open(new, "wb") as file, open(path, "rb") as old:
        writer = McapWriter.of_job(file, job, rings.times)
        found = NonSeekingReader(old).iter_messages(log_time_order=False)
        going_on = True
        while going_on:
            going_on, made = False, defaultdict[str, list[tuple[int, bytes]]](list)
            with suppress(Exception):  # the library raises whatever half a record makes of it
                for _, channel, message in islice(found, _AT_ONCE):
                    going_on, t_ns = True, message.log_time
                    made[channel.topic].append((t_ns, message.data))
                    if t_ns > last_ns:
                        last_ns, seen = t_ns, dict.fromkeys(TOPICS, 0)
                    if channel.topic in seen:
                        seen[channel.topic] += t_ns == last_ns
            if made:
                writer.write({}, dict(made))
        held = {topic: rings.reader(topic, oldest=True) for topic in TOPICS}
        records = {topic: reader.drain() for topic, reader in held.items()}
        first_ns = [int(records[topic]["t_ns"][0]) for topic in TICK_TOPICS if held[topic].lost]
        missing_s = 1e-9 * max(0, max(first_ns, default=0) - last_ns - _NEXT_NS)
        if missing_s:
            result = result | {"success": "false", "failure_reason": f"{ended}; {missing_s:.3f} s are missing"}
        writer.write({topic: _newer(each, last_ns, seen[topic]) for topic, each in records.items()})
        writer.finish(result, ended, evidence, {topic: rings.lost(topic) for topic in TOPICS})
    return sum(writer.messages.values()), missing_s


def has_messages(path: Path) -> bool:
    """Return whether a log that may be cut off has a whole message."""
    with suppress(Exception), open(path, "rb") as file:
        return any(True for _ in NonSeekingReader(file).iter_messages(log_time_order=False))
    return False


def _newer(records: NDArray[Any], last_ns: int, seen: int) -> NDArray[Any]:
    """Return a topic's records that a file lacks, which has all before last_ns and the first `seen` of that time."""
    if "seen" in (records.dtype.names or ()):  # an object that was never seen is not in the log
        records = records[records["seen"] != 0]
    t_ns = np.maximum(records["t_ns"], 0)
    return np.concatenate([records[t_ns == last_ns][seen:], records[t_ns > last_ns]])
