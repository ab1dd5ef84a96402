"""Verdicts, on results that are made so that each of them is due."""

import pytest

from rtstack.experiments.claims import ClaimStatus
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.papers.reference_spreading.evaluation import Evaluation, kind_of
from rtstack.papers.reference_spreading.sensitivity import outcomes
from tests.support.campaign_rows import FORCE, GRABS, LIFT, rows, verdicts

LOWEST = "at +15 mm the proposed controller has the lowest mean force norm"
APART = "its 95 % intervals at -30 and 30 mm lie apart from those of “no interim mode”"
FEWEST = "no velocity feedback has the fewest successful grabs"
NOT_BELOW = "the proposed controller's success is not below any baseline's"
ORDER = "lift: no reference spreading > proposed > no interim mode"


def test_the_papers_own_numbers_hold():
    found = verdicts(rows())
    assert found[LOWEST] == found[APART] == found[ORDER] == found[NOT_BELOW] == ClaimStatus.HOLDS
    assert found[FEWEST] == ClaimStatus.WITHIN  # 8 and 16 of 20: Wilson's intervals touch


def test_noise_makes_it_within_the_intervals():
    found = verdicts(rows(force=FORCE | {Controller.NO_INTERIM: 25.3}, noise=0.5))
    assert found[LOWEST] in (ClaimStatus.WITHIN, ClaimStatus.DIFFERS)
    assert found[APART] in (ClaimStatus.WITHIN, ClaimStatus.DIFFERS)


def test_another_order_differs():
    found = verdicts(rows(force=FORCE | {Controller.NO_INTERIM: 20.0}, lift=LIFT | {Controller.PROPOSED: -3.0}))
    assert found[LOWEST] == found[APART] == found[ORDER] == ClaimStatus.DIFFERS


def test_all_or_none_successful_tells_nothing():
    found = verdicts(rows(grabs=dict.fromkeys(FORCE, 20)))
    assert (found[FEWEST], found[NOT_BELOW]) == (ClaimStatus.UNDECIDED, ClaimStatus.WITHIN)


def test_a_baseline_that_succeeds_more_often_differs():
    assert verdicts(rows(grabs=GRABS | {Controller.NO_INTERIM: 19}))[NOT_BELOW] == ClaimStatus.DIFFERS


def test_lift_is_against_its_own_reference_and_displacement():
    made = rows(noise=0.0)
    for each in made:
        if each["max_lift_mm"] is not None and each["reference"] == "rice_box/0":
            each["max_lift_mm"] += 100.0 + each["displacement_mm"]
    lines = {line.controller: line.lift_mm.mean for line in Evaluation(made).table2()}
    middle = sum(LIFT.values()) / 4
    assert lines == pytest.approx({controller: lift - middle for controller, lift in LIFT.items()})


def test_failures_are_counted_without_their_numbers():
    a = kind_of("safety stop: left: joint 6: the torque is too large (12.3 Nm, allowed 12)")
    assert a == kind_of("safety stop: left: joint 6: the torque is too large (14.1 Nm, allowed 12)")
    assert kind_of("the object was not held until release") == "the object was not held until release"


def test_conditions_side_by_side_say_where_an_order_appears():
    equal = dict.fromkeys(GRABS, 20)
    nominal = [r for r in rows(grabs=equal) if r["experiment"] == "table2"]
    hard = [r | {"conditions": "hard"} for r in rows(grabs=GRABS) if r["experiment"] == "table2"]
    for r in nominal + hard:
        r["average_force_norm"] = FORCE[Controller(r["controller"])] + 0.01 * len(r["reference"])
    lines = {o.conditions: o for o in outcomes([Evaluation(nominal + hard, name) for name in ("nominal", "hard")])}
    assert dict(lines["nominal"].verdicts)[FEWEST] == ClaimStatus.UNDECIDED
    assert dict(lines["hard"].verdicts)[FEWEST] in (ClaimStatus.HOLDS, ClaimStatus.WITHIN)
    assert lines["hard"].lowest.startswith("Proposed approach")
