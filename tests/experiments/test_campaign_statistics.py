"""Intervals against numbers that are not ours."""

import numpy as np
import pytest
from scipy import stats

from rtstack.experiments.claims import ClaimStatus, at_least, at_most, combined, order
from rtstack.experiments.statistics import Interval, plain_mean, proportion, stratified_mean


def test_one_group_is_students_interval():
    values = [3.1, 2.7, 3.9, 3.3, 2.2]
    low, high = stats.t.interval(0.95, 4, np.mean(values), stats.sem(values))
    interval = plain_mean(values)
    assert (interval.mean, interval.low, interval.high) == pytest.approx((np.mean(values), low, high))


def test_two_groups_of_one_size_are_welchs_interval():
    a, b = [1.0, 2.0, 4.0, 3.0], [11.0, 10.5, 10.0, 12.0]
    welch = stats.ttest_ind(a, np.negative(b), equal_var=False).confidence_interval(0.95)
    interval = stratified_mean({"a": a, "b": b})
    assert (interval.low, interval.high) == pytest.approx((welch.low / 2, welch.high / 2))


def test_what_differs_between_groups_is_no_uncertainty():
    near = stratified_mean({0: [1.0, 1.1], 1: [1.0, 1.1]})
    apart = stratified_mean({0: [1.0, 1.1], 1: [101.0, 101.1]})
    assert apart.high - apart.low == pytest.approx(near.high - near.low)


def test_it_covers_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(5)
    truth = np.array([1.0, 5.0, 9.0])
    covered = 0
    for _ in range(600):
        interval = stratified_mean({k: rng.normal(truth[k], 1.0 + k, 5) for k in range(3)})
        covered += interval.low <= truth.mean() <= interval.high
    assert 0.92 < covered / 600 < 0.98


def test_too_few_repetitions_have_no_interval():
    assert stratified_mean({0: [1.0], 1: [2.0, 3.0]}) == Interval(1.75, None, None, 3)
    assert stratified_mean({}) is None


@pytest.mark.parametrize(("k", "n"), [(18, 20), (20, 20), (0, 20), (8, 20)])
def test_shares_have_wilsons_interval(k, n):
    """Its ends are the shares p at which k/n lies z standard deviations sqrt(p (1 - p) / n) away."""
    interval, z = proportion(k, n), stats.norm.ppf(0.975)
    for end in {interval.low, interval.high} - {0.0, 1.0}:
        assert abs(k / n - end) == pytest.approx(z * (end * (1 - end) / n) ** 0.5, rel=1e-9)
    assert (interval.low == 0.0, interval.high == 1.0) == (k == 0, k == n)


def test_below_means_wholly_below():
    assert Interval(1.0, 0.5, 1.5, 5).below(Interval(3.0, 1.6, 4.0, 5))
    assert not Interval(1.0, 0.5, 1.7, 5).below(Interval(3.0, 1.6, 4.0, 5))
    assert Interval(1.0, None, None, 1).below(Interval(3.0, 1.6, 4.0, 5)) is None


LOW, HIGH, WIDE = Interval(1.0, 0.9, 1.1, 9), Interval(2.0, 1.9, 2.1, 9), Interval(1.6, 0.5, 2.7, 9)
ALONE = Interval(0.0, None, None, 1)  # one trial


@pytest.mark.parametrize(
    ("pair", "verdict"),
    [
        ((LOW, HIGH), ClaimStatus.HOLDS),
        ((HIGH, LOW), ClaimStatus.DIFFERS),
        ((LOW, WIDE), ClaimStatus.WITHIN),
        ((WIDE, LOW), ClaimStatus.UNDECIDED),  # against the claim by its mean, which the interval does not exclude
        ((ALONE, HIGH), ClaimStatus.UNDECIDED),
        ((None, HIGH), ClaimStatus.UNDECIDED),
    ],
)
def test_an_order_needs_intervals(pair, verdict):
    assert order([pair]) == verdict
    assert order([(LOW, HIGH), pair]) == verdict
    assert order([(HIGH, LOW), pair]) == ClaimStatus.DIFFERS


@pytest.mark.parametrize(
    ("interval", "bound", "verdict"),
    [(LOW, 1.2, ClaimStatus.HOLDS), (LOW, 0.8, ClaimStatus.DIFFERS), (LOW, 1.05, ClaimStatus.WITHIN),
     (LOW, 0.95, ClaimStatus.UNDECIDED), (ALONE, 9.0, ClaimStatus.UNDECIDED), (None, 9.0, ClaimStatus.UNDECIDED)],
)  # fmt: skip
def test_a_bound_needs_an_interval(interval, bound, verdict):
    assert at_most(interval, bound) == verdict
    assert at_least(None if interval is None else interval.negative, -bound) == verdict


def test_a_claim_of_several_parts_is_as_its_worst_part():
    assert combined([]) == ClaimStatus.UNDECIDED
    assert combined([ClaimStatus.HOLDS, ClaimStatus.WITHIN]) == ClaimStatus.WITHIN
    assert combined([ClaimStatus.UNDECIDED, ClaimStatus.DIFFERS, ClaimStatus.HOLDS]) == ClaimStatus.DIFFERS
