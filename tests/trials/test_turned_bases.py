"""Bases that stand turned, as the cell's file says: a grab is what it is where they stand straight."""

import pytest

from tests.support.turned_cell import TURNED, BuiltCell


@pytest.mark.parametrize("variation", [0, 5])
def test_a_good_grab_with_turned_bases_is_expected(tmp_path, variation) -> None:
    turned, recording = BuiltCell.write(tmp_path, TURNED), tmp_path / "taught.mcap"
    assert turned.teach(recording, variation, seed=variation).success
    result = turned.trial(recording, tmp_path / "trial.mcap", seed=1000 + variation)
    assert result.success
    assert (result.impact_verdict, result.impact_reason) == ("expected", None)
