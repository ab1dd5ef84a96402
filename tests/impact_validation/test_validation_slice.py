"""A slice of the campaign through its real parts: references planned, trials run and logged, fitted, reported."""

import json
from dataclasses import replace

import pytest

from rtstack.campaign.plan import plan_file
from rtstack.campaign.store import Store, columns_of
from rtstack.campaign.worker import LOGS, RECORDINGS, digests
from rtstack.cli.cells import default_cell_file
from rtstack.cli.validation import open_validation_cell
from rtstack.impact_map import ReflectedInertia
from rtstack.impact_validation.evaluation import tables
from rtstack.impact_validation.plan import DIRECTIONS, JointFriction, ValidationTrial, load_validation_plan
from rtstack.impact_validation.report import write_report
from rtstack.impact_validation.worker import Measured, ValidationBench, plan_reference, run
from rtstack.references.motion import Motion
from rtstack.trials.result import TrialResult


def test_a_slice_ends_in_an_estimate_near_the_prediction(cell, tmp_path):
    """One object, one case, two references, one trial each; friction as published, so that no sweeps are needed."""
    file = plan_file("impact-map-validation")
    whole = load_validation_plan(file.path)
    nominal = replace(whole.conditions["nominal"], joint_friction=JointFriction.PUBLISHED)
    push = whole.scenario(Motion.HIT_AND_PUSH)
    plan = replace(
        whole, objects=("box_130",), scales=(0.9, 1.1), repetitions=1, conditions={"nominal": nominal},
        scenarios=(replace(push, cases={"1": push.cases["1"]}),), digest="d",
    )  # fmt: skip
    source = default_cell_file()
    bench = ValidationBench(tmp_path, source, open_validation_cell, plan.robot, nominal, "d", digests([source]))
    for folder in (RECORDINGS, LOGS):
        (tmp_path / folder).mkdir()
    with Store(tmp_path, columns_of(ValidationTrial, TrialResult, Measured)) as store:
        store.claim(plan, file)
        for trial in plan.trials():
            reference = plan.reference(trial)
            plan_reference(bench, reference, push)
            row = run(bench, trial, reference, push.gains, nominal)
            assert row["success"], row["failure_reason"]
            assert row["complete"]
            store.add(row)
        slow, fast = store.rows(plan.trials())
        # too slow a reference has to be held back, too fast a one driven on
        assert slow["net_feedback_m_s"] < 0.0 < fast["net_feedback_m_s"]
        assert fast["planned_m_s"] == pytest.approx(1.1 * fast["predicted_B_theta_m_s"], rel=1e-6)
        assert slow["predicted_none_m_s"] < slow["predicted_B_theta_m_s"] < slow["predicted_B_m_s"]
        (table,) = tables([slow, fast])
        assert abs(table.errors(ReflectedInertia.B_THETA)[0]) < 10.0
        page = write_report(store, plan, file, cell).read_text()
    assert "self-consistency check" in page
    assert (tmp_path / "figures" / "figure6.png").exists()
    written = json.loads((tmp_path / RECORDINGS / plan.references()[0].file).with_suffix(".json").read_text())
    assert written["planned"] == slow["planned_m_s"]
    assert DIRECTIONS[Motion.HIT_AND_PUSH].arms == (0,)
