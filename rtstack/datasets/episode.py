"""An episode: a log in memory, with what its data set says of it."""

import hashlib
import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.topic import Topic
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.log.writing.job import Attachment
from rtstack.log.writing.pictures import camera_topics
from rtstack.samples import SIDES
from rtstack.topics import ARM_TOPICS, TOPICS

PICTURES = re.compile(r"/camera/(\w+)/image")
_STAMP = re.compile(r"(\d{8})-(\d{6})-")  # of the logs of `rtstack up`: UTC
NONE = "none"  # a label that the log does not have


@dataclass(frozen=True, slots=True)
class Pictures:
    """What a camera has given: JPEG each, and when, ns of the robot's time, in order; about: calibration and frame, as
    the log has them, by topic: (t_ns, message)."""

    t_ns: tuple[int, ...]
    jpeg: tuple[bytes, ...]
    about: Mapping[str, tuple[int, bytes]]


@dataclass(frozen=True)
class Episode:
    """A log in memory. digest: SHA-256 of its file. records: by topic, (n,) each, t_ns in ns of the robot's time.

    pictures: of each camera, by its name."""

    path: Path
    digest: str
    start_ns: int
    metadata: Mapping[str, Mapping[str, str]]
    attachments: tuple[Attachment, ...]
    records: Mapping[str, NDArray[Any]]
    pictures: Mapping[str, Pictures] = field(default_factory=dict)

    @property
    def sides(self) -> tuple[str, ...]:
        """The sides of the arms that it has samples of, left before right: one or two."""
        return tuple(side for side, topic in zip(SIDES, ARM_TOPICS, strict=True) if len(self.records[topic]))

    @property
    def labels(self) -> dict[str, str]:
        """What came out: success (true or false), impact_verdict and failure_reason; "none" where the log has none."""
        result = self.metadata.get("result", {})
        found = {name: result.get(name, "null") for name in ("success", "impact_verdict", "failure_reason")}
        return {name: NONE if value == "null" else value for name, value in found.items()}

    @property
    def facts(self) -> dict[str, str]:
        """What was asked: kind, object, controller, cell, seed; "none" where the log does not say it."""
        trial, result = self.metadata.get("trial", {}), self.metadata.get("result", {})
        names = ("kind", "object", "controller", "cell", "seed")
        return {name: trial.get(name) or result.get(name) or NONE for name in names}

    @property
    def task(self) -> str:
        """The task in words, by the object and the motion of the reference."""
        thing, arms = self.facts["object"], "both arms" if len(self.sides) == 2 else f"the {self.sides[0]} arm"
        if thing == NONE:
            return f"move {arms}"
        return f"{self.metadata.get('trial', {}).get('motion', 'grab')} the {thing.replace('_', ' ')} with {arms}"

    @property
    def recorded(self) -> datetime:
        """When it was recorded, UTC: by the name that `rtstack up` gives a log, else by the file's last change."""
        named = _STAMP.match(self.path.name)
        if named:
            return datetime.strptime(named[1] + named[2], "%Y%m%d%H%M%S").replace(tzinfo=UTC)
        return datetime.fromtimestamp(self.path.stat().st_mtime, UTC)

    @cached_property
    def cell(self) -> Mapping[str, Any]:
        """The cell's file as the log has it, empty where it has none."""
        for attachment in self.attachments:
            if attachment.name == "cell.toml":
                return tomllib.loads(attachment.data.decode())
        return {}

    @property
    def source(self) -> str:
        """Everything that the log says in words, as JSON: its records of metadata, its name and its digest."""
        return json.dumps(
            {"file": self.path.name, "sha256": self.digest} | {k: dict(v) for k, v in self.metadata.items()}
        )


def check_log(path: Path) -> Log:
    """Open a log that may become an episode. Raises LogError with one line."""
    log = read_log(path)
    if not any(map(log.count, ARM_TOPICS)):
        raise LogError(f"{path}: it has no samples of an arm: there is nothing to export")
    return log


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_episode(path: Path, digest: str) -> Episode:
    """Read a whole log. Raises LogError with one line."""
    log = check_log(path)
    parts: dict[str, list[NDArray[Any]]] = {name: [np.zeros(0, topic.record)] for name, topic in TOPICS.items()}
    for batch in log.batches(list(TOPICS), chunks=64):  # in one go: topic by topic takes twice the time
        for name, part in batch.records.items():
            parts[name].append(part)
    records = {name: np.concatenate(each) for name, each in parts.items()}
    cameras = (found[1] for topic in log.topics if (found := PICTURES.fullmatch(topic)))
    pictures = {name: shown for name in cameras if (shown := _pictures(log, name)).t_ns}
    return Episode(path, digest, log.start_ns, log.metadata, log.attachments, records, pictures)


def _pictures(log: Log, name: str) -> Pictures:
    topic, *others = camera_topics(name)
    shown = log.pictures(topic)
    about = {other: said[0] for other in others if (said := log.messages(other))}
    return Pictures(tuple(t_ns for t_ns, _ in shown), tuple(jpeg for _, jpeg in shown), about)


def field_attributes(topic: Topic) -> dict[str, dict[str, str]]:
    """Return of each field of a topic what its values are: unit, frame, axes, text, values of an enumeration, bits."""
    found = {}
    for one in topic.message.fields:
        known = {
            "unit": one.unit, "frame": one.frame, "axes": " ".join(one.axes),
            "description": one.comment.replace("column-major", "row-major"),
            "values": ", ".join(f"{int(each)} {each.name.lower()}" for each in one.enum or ()),
            "bits": " ".join(one.bits),
        }  # fmt: skip
        found[one.name] = {name: value for name, value in known.items() if value}
    return found
