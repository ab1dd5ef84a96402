"""A sample of the random configurations that oracles.py computes by the thousand."""

import pytest

from tests.programs.impact_oracles import Tally, check_configuration

SAMPLES, BATCH = 60, 15


@pytest.mark.parametrize("first", range(0, SAMPLES, BATCH))
def test_every_oracle_agrees_with_the_map(first):
    tally = Tally()
    for seed in range(10_000 + first, 10_000 + first + BATCH):
        check_configuration(seed, tally)
    assert tally.failures == []
    assert tally.worst["mujoco: frictionless"] > 0.0  # it was asked
