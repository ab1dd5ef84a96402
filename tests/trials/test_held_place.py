"""A demonstration whose pads hold the object where the tracker does not show it has failed: the geometry is wrong."""

from dataclasses import replace

import pytest

from rtstack.cells import load_description
from rtstack.log.reader import read_log
from rtstack.trials.demonstration import HELD_AFTER_S, _apart
from rtstack.trials.review import log_columns

CELL = load_description(None)[0]


@pytest.fixture(scope="module")
def held(demonstration):
    log = read_log(demonstration.path)
    columns = log_columns(log)
    impact_s = float(log.metadata["result"]["detected_impact_time_s"])
    return columns, int(columns.arm["t_ns"][0, 0]) + round(1e9 * (impact_s + HELD_AFTER_S))


def moved(by: tuple[float, float, float]):
    """Return the description with both bases moved, m."""
    arms = {
        side: replace(arm, base_position=tuple(a + b for a, b in zip(arm.base_position, by, strict=True)))
        for side, arm in CELL.mountings.items()
    }
    return replace(CELL, **arms)


@pytest.mark.parametrize("by", [(0.0, 0.0, 0.0), (0.0, 0.0, 0.03), (0.03, 0.0, 0.0), (0.0, 0.02, 0.0)])
def test_a_calibration_that_is_good_enough_is_not_noticed(held, by):
    columns, t_ns = held
    assert _apart(columns, moved(by), "rice_box", t_ns) is None


@pytest.mark.parametrize("by", [(0.0, 0.0, 0.2), (0.0, 0.0, -0.2), (0.2, 0.0, 0.0), (0.0, 0.1, 0.0)])
def test_bases_that_are_wrong_by_a_hand_are_said_with_both_places(held, by):
    columns, t_ns = held
    said = _apart(columns, moved(by), "rice_box", t_ns)
    assert said is not None
    assert said.startswith("the left pad holds the object at (")
    assert "rtstack calibrate" in said


def test_an_object_that_is_not_seen_says_nothing(held):
    columns, t_ns = held
    assert _apart(replace(columns, object=columns.object[:0]), moved((0.0, 0.0, 0.2)), "rice_box", t_ns) is None
