"""A slice of the campaign through its real parts: references planned, trials run and logged, fitted, reported."""

import json
from dataclasses import replace

import numpy as np
import pytest
from distributed import Client

from rtstack.campaign.plan import plan_file
from rtstack.campaign.store import Store, columns_of
from rtstack.campaign.worker import LOGS, RECORDINGS, digests
from rtstack.cli.cells import default_cell_file
from rtstack.cli.validation import open_validation_cell
from rtstack.control.parameters import FrictionParameters
from rtstack.impact_map import ReflectedInertia
from rtstack.impact_validation.evaluation import tables
from rtstack.impact_validation.plan import DIRECTIONS, JointFriction, ValidationTrial, load_validation_plan
from rtstack.impact_validation.reference import plan_reference
from rtstack.impact_validation.report import write_report
from rtstack.impact_validation.runner import ValidationRunner
from rtstack.impact_validation.worker import SWEEPS, Measured, ValidationBench, run
from rtstack.log.reader import read_log
from rtstack.planning.free import Part
from rtstack.references.motion import Motion
from rtstack.trials.friction import ArmFriction, FrictionFile, friction_toml
from rtstack.trials.result import TrialResult


def test_a_slice_ends_in_an_estimate_near_the_prediction(cell, tmp_path):
    """One object, one case, two references, one trial each; friction as published, so that no sweeps are needed."""
    file = plan_file("impact-map-validation")
    whole = load_validation_plan(file.path)
    nominal = replace(whole.conditions["nominal"], joint_friction=JointFriction.PUBLISHED)
    push = whole.scenario(Motion.HIT_AND_PUSH)
    plan = replace(
        whole, robot=101, objects=("box_130",), scales=(0.9, 1.1), repetitions=1, conditions={"nominal": nominal},
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


class Silence:
    """A progress that nobody watches."""

    def begin(self, label: str, done: int, total: int) -> None:
        assert done <= total

    def advance(self, robot_s: float) -> None:
        assert robot_s >= 0.0


def test_a_refused_plan_is_reported_and_does_not_end_the_campaign(cell, tmp_path):
    file = plan_file("impact-map-validation")
    whole = load_validation_plan(file.path)
    push = whole.scenario(Motion.HIT_AND_PUSH)
    cases = {"1": {"speed": 0.5, "travel": 0.01}, "2": {"speed": 0.5}}  # the first has no room to slow down
    plan = replace(
        whole, robot=101, objects=("box_060",), scales=(1.0,), repetitions=1,
        conditions={"nominal": whole.conditions["nominal"]},
        scenarios=(replace(push, cases=cases),), digest="d", identification_runs=1,
    )  # fmt: skip
    source = default_cell_file()
    nominal = plan.conditions["nominal"]
    bench = ValidationBench(tmp_path, source, open_validation_cell, plan.robot, nominal, "d", digests([source]))
    published = FrictionParameters()
    names = ("p1", "p2", "p3", "gravity_share")
    identified = ArmFriction(**{name: tuple(getattr(published, name)) for name in names}, rms_nm=(0.0,) * 7)
    friction = FrictionFile(cell.name, plan.robot, 1, identified, identified)
    (tmp_path / "friction.toml").write_text(friction_toml(friction), encoding="utf-8")
    with (
        Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0") as client,
        Store(tmp_path, columns_of(ValidationTrial, TrialResult, Measured)) as store,
    ):
        store.claim(plan, file)
        runner = ValidationRunner(plan, bench, store, client, Silence(), cell)
        runner.run()
        assert [reference.case_name for reference in runner.refused] == ["1"]
        assert "plan a longer travel" in next(iter(runner.refused.values()))
        assert [row["case_name"] for row in store.rows()] == ["2"]
        # what is left of friction was identified along the other one, in free space, and is in its feedforward
        parts = [runs for runs in plan.free_runs() if runs.case_name == "2"]
        assert [runs.part for runs in parts] == list(Part)
        for runs in parts:
            metadata = read_log(tmp_path / SWEEPS / runs.log(0)).metadata
            assert (metadata["trial"]["object"], metadata["result"]["success"]) == ("", "true")
        (reference,) = (one for one in plan.references() if one.case_name == "2")
        free_of_it = replace(reference, along=False)
        assert plan_reference(bench, free_of_it, plan.scenario(Motion.HIT_AND_PUSH)) is None
        with_it, without = (read_log(tmp_path / RECORDINGS / one.file) for one in (reference, free_of_it))
        added = with_it.topic("/left/control")["wrench_ff"] - without.topic("/left/control")["wrench_ff"]
        assert 0.02 < np.abs(added[:, :3]).max() < 3.0
        page = write_report(store, plan, file, cell, runner.refused).read_text()
    assert "could not be planned: 1; trials not run for that reason: 1." in page
    assert "trials are missing" not in page
