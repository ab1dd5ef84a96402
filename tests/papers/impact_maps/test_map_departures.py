"""The departures from the impact-map paper say what the code and the plan have."""

import sys
from pathlib import Path

from rtstack.planning.request import GrabPlan

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "docs/generate"))

from departures.impact_maps import DEPARTURES


def test_departures_are_built_from_the_settings():
    assert len({(one.equation, one.we_do) for one in DEPARTURES}) == len(DEPARTURES)
    assert all(one.paper == "Impact maps" and one.effect for one in DEPARTURES)
    first = DEPARTURES[0]
    assert f"follows the {GrabPlan().map} map by default" in first.we_do
    assert "single_step (conditions nominal)" in first.we_do
    (speeds,) = [one for one in DEPARTURES if one.equation == "VI, case 2"]
    assert "0.43 and 0.62 m/s upwards" in speeds.we_do
