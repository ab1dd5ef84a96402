"""Which logs become the episodes of a data set, and why the others do not."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rtstack.datasets.episode import PICTURES, check_log, digest_of
from rtstack.log.errors import LogError
from rtstack.log.reader import Log
from rtstack.log_folder.catalogue import Catalogue, LogCondition, LogEntry, entry_of
from rtstack.log_folder.log_rows import LogRow, log_row
from rtstack.log_folder.remarks import EpisodeVerdict, load_remarks
from rtstack.log_folder.search import Condition, Facts, FilterRefused, parsed, success_of
from rtstack.topics import TICK_TOPICS


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
