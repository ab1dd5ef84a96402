"""Short logs for the tests of data sets."""

from pathlib import Path

import numpy as np
import pytest

from rtstack.log.writing.mcap_writer import McapWriter
from rtstack.topics import TOPICS
from tests.support.log.samples import MS, TRIAL, WrittenLog, write_log

BINARY = bytes(range(256)) * 2  # of what a fault leaves: no text
THING = {**TRIAL, "object": "rice_box"}


@pytest.fixture(scope="session")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[WrittenLog, WrittenLog]:
    """Two logs; the name of one has the local time that a stack gave it."""
    folder = tmp_path_factory.mktemp("logs")
    names = "20261122-234722-trial-rice_box.mcap", "other.mcap"
    first, second = (write_log(folder / name, 430 + 17 * k, k, THING) for k, name in enumerate(names))
    return first, second


@pytest.fixture
def write_short(tmp_path: Path):
    """Write a log of 60 ticks beside others. poses: quaternions (60, 4); without: topics; more: records of metadata."""

    def write(name, trial, result, utc=None, poses=None, without=(), more=()):
        path = tmp_path / "logs" / name
        path.parent.mkdir(exist_ok=True)
        records = {}
        for topic in ("/left/arm", "/right/arm", "/left/control", "/right/control", "/timing", "/object/pose"):
            if topic not in without:
                records[topic] = np.zeros(60, TOPICS[topic].record)
                records[topic]["t_ns"] = MS * np.arange(1, 61)
                # one value that only this log has: a copy is another test
                records[topic][TOPICS[topic].message.fields[0].name].reshape(60, -1)[0, 0] = hash(name) % 10_000
        for side in ("left", "right"):
            records.setdefault(f"/{side}/control", np.zeros(60, TOPICS[f"/{side}/control"].record))
            records[f"/{side}/control"]["pose_ref"][:, 3:] = [1, 0, 0, 0] if poses is None else poses
        records["/object/pose"]["orientation_wxyz"] = [1, 0, 0, 0] if poses is None else poses
        records["/object/pose"]["seen"] = 1
        with open(path, "wb") as file:
            writer = McapWriter(file)
            writer.write_metadata("trial", trial)
            writer.attach("last_second.npz", "application/zip", BINARY)
            if utc is not None:
                said = {"robot_time": "own clock", "utc": utc, "t_ns": str(MS), "utc_uncertainty_s": "0.001"}
                writer.write_metadata("time", said)
            writer.write({topic: each for topic, each in records.items() if topic not in without})
            for key, values in (("result", result), *more):
                if values:
                    writer.write_metadata(key, values)
            writer.close()
        return path

    return write
