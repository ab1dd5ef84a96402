"""An episode: a log in memory, with what its data set says of it; which logs become one, and why the others do not."""

import hashlib
import json
import re
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
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
from rtstack.log_folder.catalogue import Catalogue, LogCondition, LogEntry, entry_of
from rtstack.log_folder.log_rows import LogRow, log_row
from rtstack.log_folder.remarks import EpisodeVerdict, load_remarks
from rtstack.log_folder.search import Condition, Facts, FilterRefused, parsed, success_of
from rtstack.samples import SIDES
from rtstack.topics import ARM_TOPICS, TICK_TOPICS, TOPICS

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


@dataclass(frozen=True, slots=True)
class Candidate:
    """A log that may become an episode.

    row and recorded (UTC): of the list of logs. why: why it is left out, or empty; wrong: the file is the reason, and
    not what was asked for. digest and shape: of its content, and which topics and cameras its frames have; empty where
    it is left out.
    """

    path: Path
    row: LogRow | None = None
    recorded: str | None = None
    why: str = ""
    wrong: bool = False
    digest: str = ""
    shape: frozenset[str] = frozenset()

    def without(self, why: str, wrong: bool = True) -> "Candidate":
        return replace(self, why=why, wrong=wrong)


def select(places: Sequence[Path], query: str = "", failed: bool = False, alike: bool = True) -> list[Candidate]:
    """Return all logs in order, those of a folder by name, with why they are left out.

    Left out: a discarded run unless the query asks for a verdict; one without success unless it asks for success or a
    verdict, a person kept it, or failed is set.

    Args:
        places: logs, and folders of logs.
        query: words of the search in the list of logs (rtstack.log_folder.search), all of which have to hold.
        failed: take runs that have failed or have no result, too.
        alike: leave out the logs whose topics and cameras are not those of most.

    Raises LogError for a query that means nothing.
    """
    try:
        conditions = parsed(query)
    except FilterRefused as error:
        raise LogError(str(error)) from None
    found: list[Candidate] = []
    for place in places:
        try:
            entries = [entry_of(place)] if not place.is_dir() else Catalogue(place).entries()
        except (LogError, OSError) as error:
            found.append(Candidate(place, why=unreadable(place, error), wrong=True))
            continue
        if not entries:
            found.append(Candidate(place, why="there is no log in this folder", wrong=True))
        found += [_candidate(entry, conditions, failed) for entry in sorted(entries, key=lambda each: each.path)]
    digests: dict[str, Path] = {}  # a copy or another name of a log is the same episode
    for number, each in enumerate(found):
        if not each.why and each.digest in digests:
            found[number] = each.without(f"it is the same log as {digests[each.digest]}")
        elif not each.why:
            digests[each.digest] = each.path
    shapes = Counter(each.shape for each in found if not each.why)
    if not alike or len(shapes) < 2:
        return found
    most = shapes.most_common(1)[0][0]
    return [each if each.why or each.shape == most else each.without(_unlike(each.shape, most)) for each in found]


def _candidate(entry: LogEntry, conditions: Sequence[Condition], failed: bool) -> Candidate:
    row = log_row(entry, None)
    known, facts = Candidate(entry.path, row, entry.recorded), Facts.of(entry, row)
    try:
        if entry.condition is not LogCondition.COMPLETE:
            check_log(entry.path)  # which says what is wrong with it
        lacking = (each.lacking(facts) for each in conditions)
        asked = {each.key for each in conditions if each.sign}
        if why := next(filter(None, lacking), None) or _unwanted(row, asked, failed):
            return known.without(why, wrong=False)
        load_remarks(entry.path)  # of which the list says nothing where they are broken
        log = check_log(entry.path)
        if "recovery" in log.metadata and row.episode_verdict is not EpisodeVerdict.KEPT:
            return known.without("recovered log: samples may be missing; give it the verdict kept to take it")
        return replace(known, digest=digest_of(entry.path), shape=_shape(log))
    except (LogError, OSError) as error:
        return known.without(unreadable(entry.path, error))


def unreadable(path: Path, error: LogError | OSError) -> str:
    """Return why a log cannot be an episode, without its name in front."""
    text = error.strerror if isinstance(error, OSError) else str(error)
    return f"cannot be read: {(text or '').removeprefix(str(path)).lstrip(': ')}"


def _unwanted(row: LogRow, asked: set[str], failed: bool) -> str:
    """Return why a log is left out that the query would take, empty where it is not. asked: keys of the query."""
    if row.episode_verdict is EpisodeVerdict.DISCARD and "verdict" not in asked:
        return "verdict is discard"
    success = success_of(row)
    if success or failed or asked & {"success", "verdict"} or row.episode_verdict is EpisodeVerdict.KEPT:
        return ""
    if success is None:
        return "no success: it has no result"
    why = "verdict is failed" if row.episode_verdict is EpisodeVerdict.FAILED else row.outcome.removeprefix("failed: ")
    return f"success is false: {why}"


def _shape(log: Log) -> frozenset[str]:
    """Return the topics that decide which features the frames of a log have."""
    deciding = {name for name in log.topics if name in TICK_TOPICS or PICTURES.fullmatch(name)}
    return frozenset(filter(log.count, deciding))


def _unlike(shape: frozenset[str], most: frozenset[str]) -> str:
    lacks, more = (", ".join(sorted(each)) for each in (most - shape, shape - most))
    said = " and ".join(filter(None, (lacks and f"lacks {lacks}", more and f"has {more} too")))
    return f"another shape: most logs are alike, it {said}; export it by itself"
