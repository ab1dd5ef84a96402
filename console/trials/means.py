"""The means of the trials in a list: a line for each controller and object, and its points over the shift."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from console.log_rows import Ending, LogRow


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

    trials: that have ended; successes of them, unexpected: of the successes, those with an impact that was not meant.
    """

    controller: str
    object: str
    trials: int
    successes: int
    unexpected: int
    whole: Mean
    points: tuple[Mean, ...]


def means_of(rows: Iterable[LogRow], measure: Measure) -> list[MeansOf]:
    """Return the means of these trials, those without a result left out, in the order in which they come."""
    groups: dict[tuple[str, str], list[LogRow]] = {}
    for row in rows:
        if row.success is not None:
            groups.setdefault((row.controller or "", row.object or ""), []).append(row)
    return [_of_group(*key, group, measure) for key, group in groups.items()]


def _of_group(controller: str, thing: str, rows: list[LogRow], measure: Measure) -> MeansOf:
    places: dict[float, list[LogRow]] = {}
    for row in rows:
        places.setdefault(row.displacement_mm or 0.0, []).append(row)
    values = {place: _values(group, measure) for place, group in sorted(places.items())}
    return MeansOf(
        controller=controller,
        object=thing,
        trials=len(rows),
        successes=sum(row.success is True for row in rows),
        unexpected=sum(row.ending is Ending.UNEXPECTED for row in rows),
        whole=_mean(None, {place: group for place, group in values.items() if group}, measure),
        points=tuple(_mean(place, {place: group} if group else {}, measure) for place, group in values.items()),
    )


def _values(rows: list[LogRow], measure: Measure) -> list[float]:
    found = [getattr(row, measure) for row in rows]
    return [float(value) for value in found if value is not None]


def _mean(place: float | None, groups: Mapping[object, list[float]], measure: Measure) -> Mean:
    from rtstack.experiments.statistics import proportion, stratified_mean  # SciPy takes a second to load

    every = [value for group in groups.values() for value in group]
    interval = (
        proportion(round(sum(every)), len(every)) if measure is Measure.SUCCESS else stratified_mean(groups)
    )  # fmt: skip
    if interval is None:
        return Mean(place, 0, None, None, None)
    return Mean(place, interval.n, interval.mean, interval.low, interval.high)
