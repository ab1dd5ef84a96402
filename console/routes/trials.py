"""What trials have come to: the card of one, and the means of the queue's."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum

from fastapi import APIRouter

from console.parts import NeedsParts
from console.refused import Refused
from console.review.logs import opened_entry
from console.routes.problems import problems
from console.trials.card import TrialCard, trial_card
from rtstack.log.errors import LogError
from rtstack.log_folder.log_rows import Ending, LogRow, log_row

router = APIRouter(prefix="/api", tags=["trials"], responses=problems(500))


class Measure(StrEnum):
    """What the means are of: a column of the list of logs."""

    FORCE = "average_force_norm"
    LIFT = "max_lift_mm"
    SUCCESS = "success"


@dataclass(frozen=True, slots=True)
class Mean:
    """The mean of n values with its 95 % confidence interval, None where there are too few to tell.

    A share of successes is between 0 and 1, with Wilson's interval. displacement_mm: of all of them, None in a line.
    """

    displacement_mm: float | None
    n: int
    mean: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class MeansOf:
    """One controller with one object. whole: over all shifts, each counting alike; points: by shift, in order.

    trials: that have ended; successes of them, unexpected: of the successes, those with an impact that was not meant;
    aborted: further ones, which an operator, a watchdog or a robot has ended: they count against no controller.
    """

    controller: str
    object: str
    trials: int
    successes: int
    unexpected: int
    aborted: int
    whole: Mean
    points: tuple[Mean, ...]


def means_of(rows: Iterable[LogRow], measure: Measure) -> list[MeansOf]:
    """Return the means of these trials, those without a result left out, in the order in which they come."""
    groups: dict[tuple[str, str], list[LogRow]] = {}
    for row in (each for each in rows if each.success is not None):
        groups.setdefault((row.controller or "", row.object or ""), []).append(row)
    return [_of_group(*key, group, measure) for key, group in groups.items()]


def _of_group(controller: str, thing: str, ended: list[LogRow], measure: Measure) -> MeansOf:
    rows = [row for row in ended if row.ending is not Ending.ABORTED]
    values: dict[float, list[float]] = {place: [] for place in sorted({row.displacement_mm or 0.0 for row in rows})}
    for row in rows:
        if (value := getattr(row, measure)) is not None:
            values[row.displacement_mm or 0.0].append(float(value))
    return MeansOf(
        controller, thing, len(rows), sum(row.success is True for row in rows),
        unexpected=sum(row.ending is Ending.UNEXPECTED for row in rows), aborted=len(ended) - len(rows),
        whole=_mean(None, {place: group for place, group in values.items() if group}, measure),
        points=tuple(_mean(place, {place: group} if group else {}, measure) for place, group in values.items()),
    )  # fmt: skip


def _mean(place: float | None, groups: Mapping[object, list[float]], measure: Measure) -> Mean:
    from rtstack.experiments.statistics import proportion, stratified_mean  # SciPy takes a second to load

    every = [value for group in groups.values() for value in group]
    interval = proportion(round(sum(every)), len(every)) if measure is Measure.SUCCESS else stratified_mean(groups)
    if interval is None:
        return Mean(place, 0, None, None, None)
    return Mean(place, interval.n, interval.mean, interval.low, interval.high)


@router.get("/trials/{log_id}/card", responses=problems(404))
def card(log_id: str, parts: NeedsParts) -> TrialCard:
    """Return a trial's card by its log's id: how it ended, three numbers beside the last ten trials, its impact."""
    if parts.queue.running() is None:
        with suppress(Refused, LogError):  # its review is opened next: it is read meanwhile
            opened_entry(parts.catalogue.entry(log_id), parts.review_cache)
    return trial_card(parts.catalogue, log_id)


@router.get("/trials/means")
def means(parts: NeedsParts, measure: Measure = Measure.FORCE) -> list[MeansOf]:
    """Return the means of the queue's trials that have ended, with 95 % intervals, by controller, object and shift."""
    logs = {entry.id: entry for entry in parts.catalogue.entries()}
    return means_of([log_row(logs[each.log], None) for each in parts.queue.view().entries if each.log in logs], measure)
