"""Two logs of one command, compared: every message's topic, log time and bytes, in the order of the file."""

import contextlib
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from rtstack.log.reader import read_log
from rtstack.topics import HOST_CLOCK_FIELDS

RTSTACK = Path(sys.executable).with_name("rtstack")


@contextlib.contextmanager
def busy_loops(number: int) -> Iterator[None]:
    """Have as many processes compute beside what runs meanwhile."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(number)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def messages(path: Path) -> list[tuple[str, int, bytes]]:
    """Return (topic, log time, bytes) of every message, no bytes where the host's clock is among the fields."""
    with open(path, "rb") as file:
        return [
            (channel.topic, message.log_time, b"" if channel.topic in HOST_CLOCK_FIELDS else message.data)
            for _, channel, message in make_reader(file).iter_messages(log_time_order=False)
        ]


def differences(ours: Path, others: Path) -> list[str]:
    """Return, in one line each, where two logs differ in what the host's clock has no part in; empty: nowhere."""
    left, right = messages(ours), messages(others)
    found = []
    counts = [Counter(topic for topic, _, _ in each) for each in (left, right)]
    if counts[0] != counts[1]:
        found.append(f"messages: {dict(counts[0])} against {dict(counts[1])}")
    for k, (a, b) in enumerate(zip(left, right, strict=False)):
        if a != b:
            found.append(f"message {k}: {a[:2]} against {b[:2]}" + ", other bytes" * (a[:2] == b[:2]))
            break
    for topic, fields in HOST_CLOCK_FIELDS.items():
        records = [read_log(path).topic(topic) for path in (ours, others)]
        for name in records[0].dtype.names or ():
            if name not in fields and not np.array_equal(records[0][name], records[1][name]):
                found.append(f"{topic}: {name} differs")
    return found
