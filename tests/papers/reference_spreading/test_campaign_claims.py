"""Verdicts, on results that are made so that each of them is due."""

from itertools import product

import numpy as np
import pytest

from rtstack.experiments.claims import ClaimStatus
from rtstack.experiments.store import columns_of, stored
from rtstack.papers.reference_spreading.claims import judge_claims
from rtstack.papers.reference_spreading.controllers import Controller
from rtstack.papers.reference_spreading.evaluation import Evaluation, kind_of
from rtstack.papers.reference_spreading.measures import Measures
from rtstack.papers.reference_spreading.names import NAMES
from rtstack.papers.reference_spreading.sensitivity import outcomes
from rtstack.papers.reference_spreading.trial import Trial
from rtstack.trials.result import TrialResult

FORCE = {
    Controller.NO_REFERENCE_SPREADING: 33.0,
    Controller.NO_VELOCITY_FEEDBACK: 32.0,
    Controller.NO_INTERIM: 29.0,
    Controller.PROPOSED: 25.0,
}
# the paper's Table II
LIFT = dict(zip(FORCE, (9.81, -17.07, 0.78, 6.47), strict=True))
GRABS = dict(zip(FORCE, (16, 8, 17, 18), strict=True))


def rows(force=FORCE, lift=LIFT, grabs=GRABS, noise=0.1):
    """Results of a made-up campaign: 20 trials a controller for Table II, 30 a cell for Figure 11."""
    rng = np.random.default_rng(1)
    made = []
    for controller in NAMES:
        for k in range(20):
            made.append(
                row("table2", f"rice_box/{k // 2}", "rice_box", -30.0 if k % 2 else 30.0, 0, controller)
                | {"success": k < grabs[controller], "failure_reason": "dropped"}
            )
        for name, d, k in product(("rice_box/0", "parcel/0"), (-30.0, -15.0, 0.0, 15.0, 30.0), range(5)):
            made.append(
                row("figure11", name, name.split("/")[0], d, k, controller)
                | {
                    "average_force_norm": force[controller] + rng.normal(0.0, noise),
                    "max_lift_mm": 250.0 + lift[controller] + rng.normal(0.0, noise),
                }
            )
    return made


def row(experiment, reference, thing, displacement_mm, repetition, controller):
    return dict.fromkeys(stored(columns_of(Trial, TrialResult, Measures))) | {
        "experiment": experiment, "conditions": "nominal", "reference": reference, "object": thing, "success": True,
        "displacement_mm": displacement_mm, "repetition": repetition, "controller": str(controller),
    }  # fmt: skip


def verdicts(made):
    return {claim.says: claim.verdict for claim in judge_claims(Evaluation(made))}


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
