"""An episode: a log in memory, with what its data set says of it."""

import hashlib
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hal.topic import Topic
from rtstack.log.errors import LogError
from rtstack.log.reader import Log, read_log
from rtstack.log.time_of_day import TimeOfDay, iso, time_of_day
from rtstack.log.writing.job import Attachment
from rtstack.log.writing.pictures import camera_topics
from rtstack.log_folder.catalogue import entry_of
from rtstack.log_folder.log_rows import LogRow, log_row
from rtstack.log_folder.search import success_of
from rtstack.samples import SIDES
from rtstack.topics import ARM_TOPICS, TOPICS

PICTURES = re.compile(r"/camera/(\w+)/image")
NONE = "none"  # a label that the log does not have
_LEAST = 0.25  # of a quaternion of length one: the first component of such a size has the sign +


@dataclass(frozen=True, slots=True)
class Pictures:
    """What a camera has given: JPEG each, and when, ns of the robot's time, in order; about: calibration and frame, as
    the log has them, by topic: (t_ns, message)."""

    t_ns: tuple[int, ...]
    jpeg: tuple[bytes, ...]
    about: Mapping[str, tuple[int, bytes]]


@dataclass(frozen=True)
class Episode:
    """A log in memory. digest: SHA-256 of its file. records: by topic, (n,) each, t_ns in ns of the robot's time,
    quaternions continuous. row: in the list of logs. time: of day, None where unknown. pictures: by camera."""

    path: Path
    digest: str
    start_ns: int
    metadata: Mapping[str, Mapping[str, str]]
    attachments: tuple[Attachment, ...]
    records: Mapping[str, NDArray[Any]]
    row: LogRow
    time: TimeOfDay | None
    pictures: Mapping[str, Pictures] = field(default_factory=dict)

    @property
    def sides(self) -> tuple[str, ...]:
        """The sides of the arms that it has samples of, left before right: one or two."""
        return tuple(side for side, topic in zip(SIDES, ARM_TOPICS, strict=True) if len(self.records[topic]))

    @property
    def labels(self) -> dict[str, str]:
        """What came out, "none" where the log does not say it: success (true or false), a person's episode_verdict,
        outcome in one line, the monitor's impact_verdict and its reasons, and why and by which fault the run ended."""
        result, fault = self.metadata.get("result", {}), self.metadata.get("fault", {})
        success = success_of(self.row)
        names = ("impact_verdict", "impact_kind", "impact_reason", "failure_reason")
        return _worded({
            "success": None if success is None else str(success).lower(),
            "episode_verdict": self.row.episode_verdict, "outcome": self.row.outcome,
            **{name: result.get(name) for name in names},
            "fault": ": ".join(filter(None, (fault.get("end"), fault.get("detail")))),
            "ended": self.metadata.get("log", {}).get("ended"),
        })  # fmt: skip

    @property
    def facts(self) -> dict[str, str]:
        """What was asked, by which operator, and when; "none" where the log does not say it. recorded_utc: of its first
        sample, with how exact that is."""
        trial, result, time = self.metadata.get("trial", {}), self.metadata.get("result", {}), self.time
        names = ("kind", "object", "controller", "cell", "seed", "operator")
        known = None if time is None else time.synchronised
        return _worded({
            **{name: trial.get(name) or result.get(name) for name in names}, "tags": " ".join(self.row.tags),
            "recorded_utc": time and iso(time.unix_ns(self.start_ns)), "utc_uncertainty_s": time and time.uncertainty_s,
            "utc_clock": None if known is None else ("" if known else "not ") + "synchronised",
            "utc_clock_error_s": time and time.error_s,
        })  # fmt: skip

    @property
    def task(self) -> str:
        """The task in words, by the object and the motion of the reference."""
        thing, arms = self.facts["object"], "both arms" if len(self.sides) == 2 else f"the {self.sides[0]} arm"
        if thing == NONE:
            return f"move {arms}"
        return f"{self.metadata.get('trial', {}).get('motion', 'grab')} the {thing.replace('_', ' ')} with {arms}"

    @cached_property
    def cell(self) -> Mapping[str, Any]:
        """The cell's file as the log has it, empty where it has none."""
        return next((tomllib.loads(a.data.decode()) for a in self.attachments if a.name == "cell.toml"), {})

    @property
    def source(self) -> str:
        """Everything that the log says in words, as JSON: its records of metadata, its name and its digest."""
        return json.dumps({"file": self.path.name, "sha256": self.digest, **self.metadata})


def _worded(values: Mapping[str, Any]) -> dict[str, str]:
    return {name: NONE if value in (None, "", "null") else str(value) for name, value in values.items()}


def check_log(path: Path) -> Log:
    """Open a log that may become an episode. Raises LogError with one line."""
    log = read_log(path)
    if not any(map(log.count, ARM_TOPICS)):
        raise LogError(f"{path}: it has no samples of an arm: there is nothing to export")
    return log


def digest_of(path: Path) -> str:
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
    for name, one in ((name, one) for name, topic in TOPICS.items() for one in topic.message.fields):
        for k in quaternions_of(one.axes):
            values = records[name][one.name]
            values[:, k : k + 4] = continuous(values[:, k : k + 4])
    cameras = (found[1] for topic in log.topics if (found := PICTURES.fullmatch(topic)))
    pictures = {name: shown for name in cameras if (shown := _pictures(log, name)).t_ns}
    row, about = log_row(entry_of(path), None), (log.start_ns, log.metadata, log.attachments)
    return Episode(path, digest, *about, records, row, time_of_day(log), pictures)


def quaternions_of(axes: Sequence[str]) -> list[int]:
    """Return where the quaternions of a field begin: at w of four neighbours w, x, y, z whose names begin alike."""
    names = [(axis[:-1], axis[-1]) for axis in axes]
    return [k for k, (prefix, _) in enumerate(names) if names[k : k + 4] == [(prefix, each) for each in "wxyz"]]


def continuous(quaternions: NDArray[np.float64], begins: bool = True) -> NDArray[np.float64]:
    """Return quaternions wxyz (n, 4) without changes of sign, each q or -q; rows of zeros or NaN are passed over.

    begins: the first component of the first one that is not small becomes positive, so that episodes of one pose begin
    alike, also where w is nearly 0.
    """
    found = quaternions.copy()
    known = np.isfinite(found).all(axis=1) & found.any(axis=1)
    rows = found[known]
    if len(rows):
        first = rows[0][np.abs(rows[0]) >= _LEAST * np.linalg.norm(rows[0])][0]
        turned = np.einsum("ij,ij->i", rows[1:], rows[:-1]) < 0.0
        found[known] = rows * np.cumprod(np.where([begins and first < 0.0, *turned], -1.0, 1.0))[:, None]
    return found


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
