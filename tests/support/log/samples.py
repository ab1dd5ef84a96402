"""Records with every field set, and how they are pushed: what the tests of the log share."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.robots import FR3
from rtstack.log.ring import Rings
from rtstack.log.writer import Attachment, CellFrames, LogProcess, LogSummary
from rtstack.samples import SIDES
from rtstack.topics import TOPICS

TICKS = 1500
MS = 1_000_000
TRIAL = {"kind": "trial", "specification": '{"controller": "proposed"}', "seed": "7"}
CELL = b"name = 'grab'\n[objects.rice_box]\nmass = 1.25\nsize = [0.2, 0.3, 0.2]\n"
RESULT = {"success": "true", "peak_force_norm": "12.5"}


def random_records(topic: str, count: int, seed: int = 0) -> NDArray[Any]:
    """Return `count` records of a topic, 1 ms apart, with a value in every field."""
    rng = np.random.default_rng([seed, list(TOPICS).index(topic)])
    records = np.zeros(count, TOPICS[topic].record)
    for name in TOPICS[topic].record.names or ():
        column = records[name]
        if column.dtype == np.float64:
            column[...] = rng.normal(size=column.shape)
        elif column.dtype == np.int64:
            column[...] = rng.integers(1, 6, size=column.shape)
    records["t_ns"] = np.arange(1, count + 1) * MS
    if "current_errors" in (records.dtype.names or ()):
        records["current_errors"] = np.where(rng.random(count) < 0.1, rng.integers(1, 1 << 41, count), 0)
        records["O_T_EE"] = np.eye(4)
        records["O_T_EE"][:, :3, 3] = rng.normal(size=(count, 3))
    for field in TOPICS[topic].message.fields:
        if field.enum is not None:
            records[field.name] = rng.choice([int(member) for member in field.enum], count)
    if topic == "/object/pose":
        records["seen"] = 1
        records["orientation_wxyz"] /= np.linalg.norm(records["orientation_wxyz"], axis=1, keepdims=True)
    if topic == "/events":
        records["name"] = b"mode"
        records["text"] = [f"event {i}".encode() for i in range(count)]
    return records


def push_all(rings: Rings, columns: dict[str, NDArray[Any]], log: LogProcess, room: int = 128) -> None:
    """Push records tick by tick, in the order of the loop, waiting for this much room every 16 ticks."""
    pushers = {topic: rings.pusher(topic) for topic in columns}
    slots = {topic: np.zeros(1, TOPICS[topic].record) for topic in columns}
    for tick in range(max(len(records) for records in columns.values())):
        if tick % 16 == 0:
            log.wait_room(room)
        for topic, records in columns.items():
            if tick < len(records):
                slots[topic][0] = records[tick]
                pushers[topic].push(slots[topic])


@dataclass(frozen=True, slots=True)
class WrittenLog:
    """A complete log, and what went into it."""

    path: Path
    columns: dict[str, NDArray[Any]]
    cell: CellFrames
    summary: LogSummary


def write_log(path: Path, ticks: int = TICKS, seed: int = 0, trial: dict[str, str] = TRIAL) -> WrittenLog:
    """Write a complete log of random records."""
    columns = {topic: random_records(topic, 5 if topic == "/events" else ticks, seed) for topic in TOPICS}
    left, right = np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])
    left[:3, 3], right[:3, 3] = (0.0, 0.4, 0.1), (0.0, -0.4, 0.1)
    cell = CellFrames(
        {"left": left, "right": right},
        dict.fromkeys(SIDES, (0.1, 0.1, 0.03)),
        dict.fromkeys(SIDES, FR3.urdf),
        (0.2, 0.3, 0.2),
        (0.08, 0.0, 0.1),
        (0.56, 0.8, 0.2),
    )
    with Rings.create() as rings:
        log = LogProcess.start(path, rings, {"trial": trial}, [Attachment("cell.toml", "application/toml", CELL)], cell)
        push_all(rings, columns, log)
        summary = log.close(RESULT)
    return WrittenLog(path, columns, cell, summary)
