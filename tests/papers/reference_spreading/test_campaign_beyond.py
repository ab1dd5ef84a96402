"""The detector against the proposed controller: each verdict where it is due, and the paper's claims without it."""

import numpy as np
import pytest

from rtstack.papers.reference_spreading.evaluation import Evaluation
from rtstack.papers.reference_spreading.report import COMPARED, OURS, THEIRS, judge_beyond, summary
from tests.support.campaign_rows import row, rows, verdicts


def _pairs(gain, noise=0.05, spread=2.0, repetitions=5):
    """Figure 11 with both. gain: what the detector adds to the mean force norm, by displacement; spread: between
    repetitions, the same for both."""
    rng = np.random.default_rng(3)
    made = []
    for d, difference in gain.items():
        for reference in ("rice_box/0", "parcel/0"):
            for k in range(repetitions):
                shared = 25.0 + spread * rng.normal()
                for controller in COMPARED:
                    ours = controller is OURS
                    each = row("figure11", reference, reference.split("/")[0], d, k, controller)
                    norm = shared + ours * (difference + noise * rng.normal())
                    made.append(
                        each
                        | {
                            "average_force_norm": norm, "peak_in_window": 60.0, "step_to_post": 0.4 if ours else 4.0,
                            "interim_ms": 170.0 if ours and d else 100.0, "detected_impact_time_s": 1.3,
                            "contact_completed_s": 1.44, "failure_reason": "dropped",
                        }
                    )  # fmt: skip
    return made


def _lines(made):
    return {line.what: line for line in judge_beyond(Evaluation(made, controllers=COMPARED))}


def test_each_verdict_where_it_is_due():
    made = _pairs({-30.0: -1.0, 0.0: 0.0, 30.0: 1.0})
    lines = _lines(made)
    assert lines["mean force norm at -30 mm"].verdict == "lower by 4 %"
    assert lines["mean force norm at 0 mm"].verdict == "no difference that these trials can tell"
    assert lines["mean force norm at +30 mm"].verdict == "higher by 4 %"
    assert summary(list(lines.values())) == (
        "Contact completion against proposed approach, mean force norm: lower at -30 mm; higher at +30 mm; "
        "no difference at 0 mm."
    )


def test_pairs_tell_what_two_means_do_not():
    """The repetitions differ by more than the controllers do; within a pair they are the same."""
    line = _lines(_pairs({-30.0: -0.5}))["mean force norm at -30 mm"]
    assert line.verdict.startswith("lower")
    alone = _lines(_pairs({-30.0: -0.5}, noise=3.0))["mean force norm at -30 mm"]
    assert alone.verdict == "no difference that these trials can tell"


def test_the_interim_mode_is_measured_against_full_contact():
    lines = _lines(_pairs({-30.0: 0.0, 0.0: 0.0}))
    margin = lines["from full contact to the interim mode's end, object displaced"]
    assert (margin.theirs, margin.ours) == ("-40.0 ms [-40.0, -40.0]", "30.0 ms [30.0, 30.0]")
    assert lines["change in the tick that ends the interim mode, object displaced"].verdict == "lower by 90 %"
    assert lines["duration of the interim mode, object in place"].difference == "0.0 ms [0.0, 0.0]"


def test_a_failed_trial_counts_as_a_grab_that_is_lost_and_not_as_a_force():
    made = _pairs({-30.0: 0.0})
    lost = next(each for each in made if each["controller"] == OURS)
    lost |= {"success": False, "average_force_norm": 1e6}
    lines = _lines(made)
    assert lines["mean force norm at -30 mm"].ours.startswith("2")
    grabs = lines["successful grabs, all trials"]
    assert (grabs.theirs, grabs.ours, grabs.verdict) == ("10 of 10", "9 of 10", "fewer")


@pytest.mark.parametrize("missing", COMPARED)
def test_without_both_there_is_nothing_to_compare(missing):
    made = [each for each in _pairs({-30.0: 0.0}) if each["controller"] != missing]
    assert judge_beyond(Evaluation(made, controllers=COMPARED)) == []


def test_one_pair_tells_nothing():
    made = [each for each in _pairs({-30.0: -9.0}, repetitions=1) if each["reference"] == "parcel/0"]
    assert _lines(made)["mean force norm at -30 mm"].verdict == "cannot be told: one pair"


def test_the_papers_claims_are_those_of_its_four():
    """A fifth controller that beats all changes no verdict, no share and no lift."""
    made = rows()
    ours = [
        each | {"controller": str(OURS), "average_force_norm": 1.0, "max_lift_mm": 900.0, "peak_torque_ratio": 1.0}
        for each in made
        if each["controller"] == THEIRS
    ]
    assert verdicts(made + ours) == verdicts(made)
    assert Evaluation(made + ours).table2() == Evaluation(made).table2()
    assert Evaluation(made + ours).failures() == Evaluation(made).failures()
