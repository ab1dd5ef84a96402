"""What cannot be planned is one line, and nothing is written."""

from dataclasses import replace

import pytest

from rtstack.impact_map import Status
from rtstack.model.cell_description import ContactFriction, Table
from rtstack.planning import GrabPlan, PlanError, PushPlan, checked_plan, plan_grab, plan_push
from rtstack.planning.feasibility import check_impact


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"speed": 3.0}, "plan: speed: .* less than or equal to 0.8"),
        ({"speed": 0.01}, "plan: speed: .* greater than or equal to 0.05"),
        ({"speed": float("nan")}, "plan: speed: .*finite"),
        ({"speeed": 0.3}, "plan: speeed: Unexpected keyword"),
        ({"inertia": "C"}, "plan: inertia: Input should be 'B_theta'"),
        ({"height": 0.2}, r"height 0.2 m: .* within -0.046 and 0.050 m"),
        ({"height": -0.048}, "height -0.048 m: .* clear the table"),
        ({"rise": 0.8}, "joint 2 is at .* times its torque limit"),
        ({"posture": 1.2}, "left arm: no configuration .* joint 1"),
        ({"lift": 0.5}, r"left arm: the pad leaves the cell's box by 70 mm along z"),
        ({"squeeze": 5.0}, "squeeze 5 N: friction 0.9 does not hold rice_box"),
        ({"lift_s": 0.4}, "lift_s 0.4 s: .* plan a slower one"),
        ({"lift_s": 0.45, "steady_s": 0.5, "rise": 0.1}, "lift_s 0.45 s: .* steady_s, 0.6 s"),
        ({"rise": 0.5, "height": -0.04}, "no room to gather 0.5 m/s along z"),
    ],
)
def test_a_grab_that_cannot_be(cell, asked, said):
    with pytest.raises(PlanError, match=said):
        plan_grab(cell, "rice_box", checked_plan(GrabPlan, **asked))


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"travel": 0.05, "speed": 0.7}, "run ahead of the pad"),
        ({"travel": 0.4}, "leaves its reach"),
        ({"travel": 0.01, "speed": 0.7}, "plan a longer travel"),
        ({"height": 0.1}, "height 0.1 m"),
    ],
)
def test_a_push_that_cannot_be(cell, asked, said):
    with pytest.raises(PlanError, match=said):
        plan_push(cell, "box_130", checked_plan(PushPlan, **asked))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"safety": {"q_upper": [-0.28, 1.7, 2.9, -0.2, 2.8, 4.5, 3.0]}}, "left arm: joint 1 .* position limit"),
        ({"safety": {"dq_max": [0.1] * 7}}, "times its velocity limit"),
        ({"safety": {"tau_max": [30.0] * 4 + [12.0] * 3}}, "times its torque limit"),
        ({"safety": {"ee_speed_max": 0.4}}, "more than 0.9 of the cell's ee_speed_max"),
        ({"table": Table((0.08, 0.0), (0.56, 0.8), 0.207)}, "would touch the table"),
        ({"contact_friction": ContactFriction(pad=0.2)}, "friction 0.2 does not hold"),
    ],
)
def test_a_cell_that_does_not_allow_it(cell, changed, said):
    with pytest.raises(PlanError, match=said):
        plan_grab(replace(cell, **changed), "rice_box", checked_plan(GrabPlan, height=0.03))


def test_an_object_that_the_cell_does_not_have(cell):
    with pytest.raises(PlanError, match="unknown object 'brick': the cell grab has rice_box"):
        plan_grab(cell, "brick")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"status": Status.INFEASIBLE, "detail": "the bodies part"}, "infeasible, the bodies part"),
        ({"status": Status.UNSOLVED}, "unsolved"),
        ({"status": Status.NOT_UNIQUE, "second_opinion_m_s": 1e-3}, "not unique"),
        ({"status": Status.NOT_UNIQUE, "second_opinion_m_s": 0.0, "spread_m_s": 0.01}, "not unique"),
    ],
)
@pytest.mark.parametrize("which", ["single_step", "converged"])
def test_an_impact_that_is_none(grabbed, changed, said, which):
    result = grabbed.map
    check_impact(result, 0.3)
    with pytest.raises(PlanError, match=said):
        check_impact(replace(result, **{which: replace(getattr(result, which), **changed)}), 0.3)


def test_a_contact_that_would_pull(grabbed):
    impulses = grabbed.map.converged.impulses.copy()
    impulses[:4, 2] -= 2.0
    with pytest.raises(PlanError, match="left on object would have to pull"):
        check_impact(replace(grabbed.map, converged=replace(grabbed.map.converged, impulses=impulses)), 0.3)


def test_loads_that_the_law_leaves_open_by_micrometres_are_a_push(pushed):
    """A box that slides on four corners has no unique impulses; its velocity is known to a ten thousandth."""
    assert pushed.map.converged.status is Status.NOT_UNIQUE
    check_impact(pushed.map, 0.6)
