"""What is said of a demonstration, of motions whose speed, angle, jerk and impacts are known."""

from typing import Any

import numpy as np
import pytest

from rtstack.control.records import POINT
from rtstack.references.recording import Recording
from rtstack.trials.extraction import remarks_on

PERIOD_S, IMPACT, TICKS = 1e-3, 1500, 2000
EXCLUSION_S = 0.06
INWARDS = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])  # of (left, right): towards each other


def demonstration(
    speed=(0.3, 0.3), direction: Any = INWARDS, hits=(IMPACT, IMPACT), impact=IMPACT, shake_m=0.0, shake_hz=4.0
):
    """Both pads get faster evenly up to the impact; one hand shakes by so much, across the way."""
    points = np.zeros((2, TICKS), POINT)
    points["position"][:, :, 1] = [[0.2], [-0.2]]
    share = np.minimum(np.arange(TICKS) / impact, 1.0) if impact else np.ones(TICKS)
    points["twist"][:, :, :3] = np.array(speed)[:, None, None] * np.array(direction)[:, None] * share[:, None]
    w = 2.0 * np.pi * shake_hz
    points["twist"][1, :, 0] += shake_m * w * np.cos(w * PERIOD_S * np.arange(TICKS))
    return Recording(points, PERIOD_S, impact, TICKS - 1, "rice_box", hits=hits)


def said(recording):
    return {remark.text: remark.good for remark in remarks_on(recording, EXCLUSION_S)}


def test_a_good_demonstration_is_good_in_everything():
    assert said(demonstration()) == {
        "speed at the impact: 0.29 and 0.29 m/s": True,
        "angle to the line between the pads: 0 and 0 deg": True,
        "jerk of the approach: 0 m/s^3": True,
        "both pads hit together": True,
    }


@pytest.mark.parametrize(("speed", "good"), [((0.3, 0.3), True), ((0.05, 0.3), False), ((0.3, 0.45), False)])
def test_the_pads_are_fast_enough_and_equally_fast(speed, good):
    assert next(iter(said(demonstration(speed)).values())) is good


@pytest.mark.parametrize(("degrees", "good"), [(0, True), (20, True), (50, False), (180, False)])
def test_the_angle_is_between_velocity_and_the_other_pad(degrees, good):
    turn = np.radians(degrees)
    left = (0.0, -np.cos(turn), np.sin(turn))
    found = said(demonstration(direction=(left, INWARDS[1])))
    assert found[f"angle to the line between the pads: {degrees} and 0 deg"] is good


def test_the_jerk_is_that_of_a_shaking_hand():
    shake_m, w = 2e-3, 2.0 * np.pi * 4.0
    (text,) = (text for text in said(demonstration(shake_m=shake_m)) if text.startswith("jerk"))
    assert float(text.split()[-2]) == pytest.approx(shake_m * w**3 / np.sqrt(2.0), rel=0.2)
    assert [good for text, good in said(demonstration(shake_m=0.02)).items() if text.startswith("jerk")] == [False]


@pytest.mark.parametrize(
    ("hits", "text", "good"),
    [
        ((IMPACT, IMPACT + 20), "the left pad hit 20 ms before the other one", True),
        ((IMPACT + 90, IMPACT), "the right pad hit 90 ms before the other one", False),
        ((None, IMPACT), "the left pad has not hit", False),
        ((IMPACT, None), "the right pad has not hit", False),
    ],
)
def test_which_pad_hits_first(hits, text, good):
    assert said(demonstration(hits=hits))[text] is good


@pytest.mark.parametrize("impact", [TICKS, 0, 40])
def test_nothing_is_said_where_no_impact_was_found_or_nothing_came_before_it(impact):
    assert remarks_on(demonstration(impact=impact), EXCLUSION_S) == ()


def test_every_bad_remark_says_what_to_do_else():
    bad = demonstration((0.05, 0.3), (INWARDS[1], INWARDS[1]), (None, IMPACT), shake_m=0.02)
    remarks = remarks_on(bad, EXCLUSION_S)
    assert len(remarks) == 4
    assert all(not remark.good and remark.advice for remark in remarks)
