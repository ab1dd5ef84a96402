"""A slice of the campaign through its real parts: references planned, trials run and logged, fitted, reported."""

import json
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from rtstack.control.parameters import FrictionParameters
from rtstack.experiments.experiment import Request, Results
from rtstack.experiments.progress import campaign_progress
from rtstack.experiments.registry import plan_file
from rtstack.experiments.report import write_report
from rtstack.experiments.runner import Runner
from rtstack.experiments.store import Store
from rtstack.impact_map import ReflectedInertia
from rtstack.log.reader import read_log
from rtstack.papers.conditions import RECORDINGS
from rtstack.papers.impact_maps.evaluation import tables
from rtstack.papers.impact_maps.experiment import Validation
from rtstack.papers.impact_maps.plan import DIRECTIONS, SWEEPS, JointFriction, load_validation_plan
from rtstack.papers.impact_maps.prediction import MapKind
from rtstack.papers.impact_maps.worker import friction_file, plan_reference
from rtstack.planning.free import PlanPhase
from rtstack.references.motion import Motion
from rtstack.trials.friction import ArmFriction, FrictionFile, friction_toml
from tests.support.dask_worker import dask_worker


@contextmanager
def ran(plan, file, out):
    """Run a campaign with one worker in this process; give it and its results."""
    validation = Validation(plan, Request(file, out))
    with dask_worker() as client, Store(out, validation.columns) as store, campaign_progress(out) as progress:
        store.claim(validation)
        Runner(validation, store, client, progress).run()
        yield validation, store


def page_of(validation, store):
    """Return the report's page."""
    rows = store.rows(validation.cases(()))
    return write_report(validation.report(Results(rows, store.out)), validation, store, rows).read_text()


@pytest.mark.long
def test_a_slice_ends_in_an_estimate_near_the_prediction(cell, tmp_path):
    """One object, one case, two references, one trial each; friction as published, so that no sweeps are needed."""
    file = plan_file("impact-map-validation")
    whole = load_validation_plan(file.path)
    nominal = replace(whole.conditions["nominal"], joint_friction=JointFriction.PUBLISHED)
    push = whole.scenario(Motion.HIT_AND_PUSH)
    plan = replace(
        whole, robots=(101,), objects=("box_130",), scales=(0.9, 1.1), repetitions=1, conditions={"nominal": nominal},
        scenarios=(replace(push, cases={"1": push.cases["1"]}),),
    )  # fmt: skip
    with ran(plan, file, tmp_path) as (validation, store):
        assert validation.refused == {}
        for row in store.rows():
            assert row["success"], row["failure_reason"]
            assert row["complete"]
        slow, fast = store.rows(plan.trials())
        # too slow a reference has to be held back, too fast a one driven on
        assert slow["net_feedback_m_s"] < 0.0 < fast["net_feedback_m_s"]
        assert fast["planned_m_s"] == pytest.approx(1.1 * fast["converged_B_theta_m_s"], rel=1e-6)
        assert slow["single_step_none_m_s"] < slow["single_step_B_theta_m_s"] < slow["single_step_B_m_s"]
        (table,) = tables([slow, fast])
        assert abs(table.errors((MapKind.SINGLE_STEP, ReflectedInertia.B_THETA), 101)[0]) < 10.0
        page = page_of(validation, store)
    assert "self-consistency check" in page
    assert (tmp_path / "figures" / "figure6.png").exists()
    written = json.loads((tmp_path / RECORDINGS / plan.references()[0].file).with_suffix(".json").read_text())
    assert written["planned"] == slow["planned_m_s"]
    assert DIRECTIONS[Motion.HIT_AND_PUSH].arms == (0,)


@pytest.mark.long
def test_a_refused_plan_is_reported_and_does_not_end_the_campaign(cell, tmp_path):
    file = plan_file("impact-map-validation")
    whole = load_validation_plan(file.path)
    push = whole.scenario(Motion.HIT_AND_PUSH)
    cases = {"1": {"speed": 0.5, "travel": 0.01}, "2": {"speed": 0.5}}  # the first has no room to slow down
    plan = replace(
        whole, robots=(101,), objects=("box_060",), scales=(1.0,), repetitions=1,
        conditions={"nominal": whole.conditions["nominal"]},
        scenarios=(replace(push, cases=cases),), identification_runs=1,
    )  # fmt: skip
    published = FrictionParameters()
    names = ("p1", "p2", "p3", "gravity_share")
    identified = ArmFriction(**{name: tuple(getattr(published, name)) for name in names}, rms_nm=(0.0,) * 7)
    friction = FrictionFile(cell.name, 101, 1, identified, identified)
    (tmp_path / friction_file(101)).write_text(friction_toml(friction), encoding="utf-8")
    with ran(plan, file, tmp_path) as (validation, store):
        assert [reference.case_name for reference in validation.refused] == ["1"]
        assert "plan a longer travel" in next(iter(validation.refused.values()))
        assert [row["case_name"] for row in store.rows()] == ["2"]
        # what is left of friction was identified along the other one, in free space, and is in its feedforward
        parts = [runs for runs in plan.free_runs() if runs.case_name == "2"]
        assert [runs.part for runs in parts] == list(PlanPhase)
        for runs in parts:
            metadata = read_log(tmp_path / SWEEPS / runs.log(0)).metadata
            assert (metadata["trial"]["object"], metadata["result"]["success"]) == ("", "true")
        (reference,) = (one for one in plan.references() if one.case_name == "2")
        free_of_it = replace(reference, along=False)
        assert plan_reference(validation._bench, free_of_it, plan.scenario(Motion.HIT_AND_PUSH)) is None
        with_it, without = (read_log(tmp_path / RECORDINGS / one.file) for one in (reference, free_of_it))
        added = with_it.topic("/left/control")["wrench_ff"] - without.topic("/left/control")["wrench_ff"]
        assert 0.02 < np.abs(added[:, :3]).max() < 3.0
        page = page_of(validation, store)
    assert "could not be planned: 1; trials not run for that reason: 1." in page
    assert "trials are missing" not in page
