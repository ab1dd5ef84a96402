"""A short run of the fuzz program: a server that is thrown nonsense at lives, goes on, leaks nothing and serves."""

import pytest
from fuzz import fuzz, leaks


@pytest.mark.realtime
def test_nonsense_harms_nobody(fresh_server) -> None:
    with fresh_server() as served:
        outcome = fuzz(served, messages=2000, seed=3, seconds=60.0)
    assert outcome.total >= 2000
    assert outcome.alive
    assert min(outcome.ids) > 0
    assert not leaks(outcome)
