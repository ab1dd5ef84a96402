"""The fastest demonstrations that a campaign of ours asks for are recorded, although they hit harder than by hand."""

import pytest

from rtstack.cells import default_cell_file
from rtstack.experiments.experiment import Request
from rtstack.experiments.registry import plan_file
from rtstack.experiments.seeds import seed_of
from rtstack.papers.demonstrations import RECORDINGS, Bench, record
from rtstack.papers.reference import Reference
from rtstack.papers.reference_spreading.experiment import ControllerComparison
from rtstack.papers.reference_spreading.plan import load_plan
from rtstack.trials.errors import TrialError


def test_what_the_sensitivity_campaign_asks_for_is_recorded(tmp_path):
    plan = load_plan(plan_file("reference-spreading-sensitivity").path)
    fastest = max(each.speed_m_s or 0.0 for each in plan.conditions.values())
    reference = Reference("rice_box", 0, fastest)
    assert reference in plan.references()
    bench = Bench(tmp_path, default_cell_file(), plan.criterion, "")
    (tmp_path / RECORDINGS).mkdir()
    seed = seed_of(plan.seed, "reference", reference.name)
    assert record(bench, reference, plan.conditions["nominal"], seed) is None


def test_trials_of_a_reference_that_cannot_be_recorded_are_left_out(tmp_path):
    file = plan_file("reference-spreading-sensitivity")
    campaign = ControllerComparison(load_plan(file.path), Request(file, tmp_path))
    size, fast = campaign.size(), "rice_box/0@0.55"
    stages = campaign.stages()
    recorded = [task.name for task in next(stages).tasks]
    assert f"reference-{fast}" in recorded
    with pytest.raises(StopIteration):
        stages.send({f"reference-{fast}": "too fast for it"})
    cases = campaign.cases([])
    assert fast not in {trial.reference for trial in cases}
    assert len(cases) == campaign.size() < size

    stages = campaign.stages()
    next(stages)
    with pytest.raises(TrialError, match="rice_box/0 could not be recorded: broken"):
        stages.send(dict.fromkeys(recorded, "broken"))
