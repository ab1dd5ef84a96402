"""Which logs become the episodes of a data set, and why the others do not."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from rtstack.datasets.episode import PICTURES, check_log, digest_of, success_of
from rtstack.log.errors import LogError
from rtstack.log.reader import Log
from rtstack.log_folder.catalogue import Catalogue, LogCondition, LogEntry, entry_of
from rtstack.log_folder.log_rows import LogRow, log_row
from rtstack.log_folder.remarks import EpisodeVerdict, load_remarks
from rtstack.log_folder.search import Condition, Facts, FilterRefused, parsed
from rtstack.topics import TICK_TOPICS


class Success(StrEnum):
    """Which runs are taken, by their success. A run that a person called failed has none."""

    TRUE = "true"
    FALSE = "false"
    ANY = "any"  # also those without a result


@dataclass(frozen=True, slots=True)
class Candidate:
    """A log that may become an episode. row and recorded (UTC): what the list of logs has of it.

    why: why it is left out, empty where it is taken. wrong: the file is the reason, and not what was asked for.
    digest and shape: of its content, and which topics and cameras its frames have; empty where it is left out.
    """

    path: Path
    row: LogRow | None = None
    recorded: str | None = None
    why: str = ""
    wrong: bool = False
    digest: str = ""
    shape: frozenset[str] = frozenset()

    def without(self, why: str, wrong: bool = True) -> "Candidate":
        """Return it, left out."""
        return replace(self, why=why, wrong=wrong)


def select(
    places: Sequence[Path], query: str = "", success: Success | None = None, alike: bool = True
) -> list[Candidate]:
    """Return the logs of some files and folders, in their order, those of a folder by name: which are taken, and why
    the others are not. Nothing is written but the cache of a folder's list.

    Args:
        places: logs, and folders of logs.
        query: words of the search in the list of logs (rtstack.log_folder.search), all of which have to hold.
        success: None: those with success, and those that a person kept. A run that was discarded is left out, unless
            the query itself asks for a verdict.
        alike: leave out the logs whose topics and cameras are not those of most.

    Raises LogError for a query that means nothing.
    """
    try:
        conditions = parsed(query)
    except FilterRefused as error:
        raise LogError(str(error)) from None
    found: list[Candidate] = []
    digests: dict[str, Path] = {}  # a copy or another name of a log is the same episode
    for each in _candidates(places, conditions, success):
        if each.digest and each.digest in digests:
            each = each.without(f"it is the same log as {digests[each.digest]}")
        elif each.digest:
            digests[each.digest] = each.path
        found.append(each)
    shapes = Counter(each.shape for each in found if not each.why)
    if not alike or len(shapes) < 2:
        return found
    most = shapes.most_common(1)[0][0]
    return [each if each.why or each.shape == most else each.without(_unlike(each.shape, most)) for each in found]


def _candidates(places: Sequence[Path], conditions: Sequence[Condition], success: Success | None) -> list[Candidate]:
    found = []
    for place in places:
        try:
            entries = (
                sorted(Catalogue(place).entries(), key=lambda each: each.path) if place.is_dir() else [entry_of(place)]
            )
        except (LogError, OSError, ValueError) as error:
            found.append(
                Candidate(place, why=f"cannot be read: {getattr(error, 'strerror', None) or error}", wrong=True)
            )
            continue
        if not entries:
            found.append(Candidate(place, why="there is no log in this folder", wrong=True))
        found += [_candidate(entry, conditions, success) for entry in entries]
    return found


def _candidate(entry: LogEntry, conditions: Sequence[Condition], success: Success | None) -> Candidate:
    row = log_row(entry, None)
    known = Candidate(entry.path, row, entry.recorded)
    facts = Facts.of(entry, row)
    try:
        if entry.condition is not LogCondition.COMPLETE:
            check_log(entry.path)  # which says what is wrong with it
        lacking = (each.lacking(facts) for each in conditions)
        asked = any(each.key == "verdict" for each in conditions)
        if why := next(filter(None, lacking), None) or _unwanted(row, success, asked):
            return known.without(why, wrong=False)
        load_remarks(entry.path)  # of which the list says nothing where they are broken
        log = check_log(entry.path)
        if "recovery" in log.metadata and row.episode_verdict is not EpisodeVerdict.KEPT:
            return known.without("recovered log: samples may be missing; give it the verdict kept to take it")
        return replace(known, digest=digest_of(entry.path), shape=_shape(log))
    except LogError as error:
        return known.without(unreadable(entry.path, error))
    except OSError as error:
        return known.without(f"cannot be read: {error.strerror}")


def unreadable(path: Path, error: LogError) -> str:
    """Return why a log cannot be an episode, without its name in front."""
    return f"cannot be read: {str(error).removeprefix(str(path)).lstrip(': ')}"


def _unwanted(row: LogRow, success: Success | None, asked: bool) -> str:
    """Return why a log is left out that the query would take, empty where it is not. asked: for a verdict."""
    if row.episode_verdict is EpisodeVerdict.DISCARD and not asked:
        return "verdict is discard"
    if success is Success.ANY or (success is None and (asked or row.episode_verdict is EpisodeVerdict.KEPT)):
        return ""
    done = success_of(row)
    if done is None:
        return "no success: it has no result"
    if done is not (success is not Success.FALSE):
        reason = (
            "verdict is failed"
            if row.episode_verdict is EpisodeVerdict.FAILED
            else row.outcome.removeprefix("failed: ")
        )
        return f"success is {str(done).lower()}: {reason}"
    return ""


def _shape(log: Log) -> frozenset[str]:
    """Return the topics that decide which features the frames of a log have."""
    return frozenset(
        name for name in log.topics if log.count(name) and (name in TICK_TOPICS or PICTURES.fullmatch(name))
    )


def _unlike(shape: frozenset[str], most: frozenset[str]) -> str:
    lacks, more = (", ".join(sorted(each)) for each in (most - shape, shape - most))
    said = " and ".join(filter(None, (lacks and f"lacks {lacks}", more and f"has {more} too")))
    return f"another shape: most logs are alike, it {said}; export it by itself"
