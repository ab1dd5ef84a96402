"""Means with 95 % confidence intervals over repetitions."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
import scipy  # loads its functions when they are used: a worker needs none

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean of n values; low and high are None where there are too few repetitions to tell."""

    mean: float
    low: float | None
    high: float | None
    n: int

    @property
    def negative(self) -> "Interval":
        """The interval of the values with the opposite sign."""
        low, high = (None if end is None else -end for end in (self.high, self.low))
        return Interval(-self.mean, low, high, self.n)

    def below(self, other: "Interval") -> bool | None:
        """Whether this interval lies wholly below the other one; None where one of them is unknown."""
        return None if self.high is None or other.low is None else self.high < other.low


def stratified_mean(groups: Mapping[object, Sequence[float]]) -> Interval | None:
    """Return the mean of the groups' means and its t interval over the repetitions within the groups.

    The groups (references, or references and displacements) are fixed, as in the paper: the interval says what the
    same experiment would give again, not what other references would. Its variance is the sum of the groups' s^2/n over
    the squared number of groups, its degrees of freedom Welch and Satterthwaite's. None without values.
    """
    values = [np.asarray(group, dtype=float) for group in groups.values() if len(group)]
    if not values:
        return None
    mean = float(np.mean([group.mean() for group in values]))
    n = sum(map(len, values))
    if any(len(group) < 2 for group in values):
        return Interval(mean, None, None, n)
    parts = np.array([group.var(ddof=1) / len(group) for group in values]) / len(values) ** 2
    variance = float(parts.sum())
    if variance == 0.0:
        return Interval(mean, mean, mean, n)
    freedom = variance**2 / float(np.sum(parts**2 / np.array([len(group) - 1 for group in values])))
    half = float(scipy.special.stdtrit(freedom, 0.5 + CONFIDENCE / 2)) * sqrt(variance)
    return Interval(mean, mean - half, mean + half, n)


def plain_mean(values: Iterable[float]) -> Interval | None:
    """Return the mean and its t interval, of values that are one group."""
    return stratified_mean({0: list(values)})


def proportion(successes: int, n: int) -> Interval | None:
    """Return a share and its Wilson interval (Wilson 1927), which stays within 0 and 1."""
    if n == 0:
        return None
    share, z = successes / n, float(scipy.special.ndtri(0.5 + 0.5 * CONFIDENCE))
    divisor = 2 * (n + z**2)
    middle = (2 * n * share + z**2) / divisor
    half = z / divisor * sqrt(4 * n * share * (1 - share) + z**2)
    return Interval(share, middle - half if successes else 0.0, middle + half if successes < n else 1.0, n)
