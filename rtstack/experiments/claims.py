"""Claims with verdicts, and numbers in words."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from rtstack.experiments.statistics import Interval


class ClaimStatus(StrEnum):
    """What became of a claim."""

    HOLDS = "holds"
    WITHIN = "holds, within the intervals"  # the means are as claimed, the intervals overlap or are unknown
    DIFFERS = "differs"
    UNDECIDED = "cannot be told"  # not in this campaign, or nothing to tell the compared ones apart


@dataclass(frozen=True, slots=True)
class Claim:
    """where: in the paper; ours: what came out here; why: what is behind it, where the claim does not hold."""

    where: str
    says: str
    ours: str
    verdict: ClaimStatus
    why: str = ""


def verdict_of(holds: bool) -> ClaimStatus:
    """Return the verdict of a claim that can be told."""
    return ClaimStatus.HOLDS if holds else ClaimStatus.DIFFERS


def order(pairs: Iterable[tuple[Interval | None, Interval | None]]) -> ClaimStatus:
    """Return the verdict of "the first is below the second", for all pairs."""
    verdict = ClaimStatus.HOLDS
    for low, high in pairs:
        if low is None or high is None:
            return ClaimStatus.UNDECIDED
        if not low.mean < high.mean:
            return ClaimStatus.DIFFERS
        if not low.below(high):
            verdict = ClaimStatus.WITHIN
    return verdict


def shown(interval: Interval | None, unit: str = "", digits: int = 1, factor: float = 1.0) -> str:
    """Return an interval in words: mean, its 95 % interval, unit."""
    if interval is None:
        return "-"
    mean = f"{factor * interval.mean:.{digits}f}"
    if interval.low is None or interval.high is None:
        return f"{mean}{unit} (n = {interval.n}, no interval)"
    return f"{mean}{unit} [{factor * interval.low:.{digits}f}, {factor * interval.high:.{digits}f}]"
