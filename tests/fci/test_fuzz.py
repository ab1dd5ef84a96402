"""A short run of the fuzz program: a server that is thrown nonsense at lives, goes on, leaks nothing and serves."""

import pytest

from tests.programs.fuzz import fuzz, leaks
from tests.support.fci.server import Served


def assert_harmed_by_nothing(served: Served) -> None:
    outcome = fuzz(served, messages=2000, seed=3, seconds=60.0)
    assert outcome.total >= 2000
    assert outcome.alive
    assert min(outcome.ids) > 0
    assert not leaks(outcome)


def test_nonsense_harms_nobody_in_lockstep(lockstep: Served) -> None:
    assert_harmed_by_nothing(lockstep)


@pytest.mark.realtime
def test_nonsense_harms_nobody_in_real_time(realtime: Served) -> None:
    assert_harmed_by_nothing(realtime)
