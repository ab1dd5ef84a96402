"""Claims with verdicts, and numbers in words."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from rtstack.experiments.statistics import Interval


class ClaimStatus(StrEnum):
    HOLDS = "holds"
    WITHIN = "holds, within the intervals"  # the means are as claimed, the 95 % intervals do not exclude the opposite
    DIFFERS = "differs"  # the 95 % intervals exclude the claim
    UNDECIDED = "cannot be told"  # no data, no interval, or means against the claim whose intervals do not exclude it


_WORST_FIRST = (ClaimStatus.DIFFERS, ClaimStatus.UNDECIDED, ClaimStatus.WITHIN, ClaimStatus.HOLDS)


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim and what came out. What the paper claims and what this project asks for are never mixed.

    where: the place in the paper; says: what the paper claims, with its number, empty where only `mark` is judged;
    ours: what came out here; why: the reason, where the claim does not hold; mark: this project's own criterion, where
    the paper gives none.
    """

    where: str
    says: str
    ours: str
    verdict: ClaimStatus
    why: str = ""
    mark: str = ""


def verdict_of(holds: bool) -> ClaimStatus:
    """Return the verdict of a claim about a count or an exact result, which has no interval."""
    return ClaimStatus.HOLDS if holds else ClaimStatus.DIFFERS


def combined(verdicts: Iterable[ClaimStatus]) -> ClaimStatus:
    """Return the verdict of a claim that consists of several: the worst of them; UNDECIDED without any."""
    found = set(verdicts)
    return next((each for each in _WORST_FIRST if each in found), ClaimStatus.UNDECIDED)


def at_most(interval: Interval | None, bound: float) -> ClaimStatus:
    """Return the verdict of "the mean is at most `bound`". UNDECIDED without an interval."""
    if interval is None or interval.low is None or interval.high is None:
        return ClaimStatus.UNDECIDED
    if interval.high <= bound:
        return ClaimStatus.HOLDS
    if interval.low > bound:
        return ClaimStatus.DIFFERS
    return ClaimStatus.WITHIN if interval.mean <= bound else ClaimStatus.UNDECIDED


def at_least(interval: Interval | None, bound: float) -> ClaimStatus:
    """Return the verdict of "the mean is at least `bound`". UNDECIDED without an interval."""
    return at_most(None if interval is None else interval.negative, -bound)


def order(pairs: Iterable[tuple[Interval | None, Interval | None]]) -> ClaimStatus:
    """Return the verdict of "the first is below the second", for all pairs."""
    return combined(_below(low, high) for low, high in pairs)


def _below(low: Interval | None, high: Interval | None) -> ClaimStatus:
    if low is None or high is None or None in (low.low, low.high, high.low, high.high):
        return ClaimStatus.UNDECIDED
    if low.below(high):
        return ClaimStatus.HOLDS
    if high.below(low):
        return ClaimStatus.DIFFERS
    return ClaimStatus.WITHIN if low.mean < high.mean else ClaimStatus.UNDECIDED


def shown(interval: Interval | None, unit: str = "", digits: int = 1, factor: float = 1.0) -> str:
    """Return an interval in words: mean, its 95 % interval, unit."""
    if interval is None:
        return "-"
    mean = f"{factor * interval.mean:.{digits}f}"
    if interval.low is None or interval.high is None:
        return f"{mean}{unit} (n = {interval.n}, no interval)"
    return f"{mean}{unit} [{factor * interval.low:.{digits}f}, {factor * interval.high:.{digits}f}]"
