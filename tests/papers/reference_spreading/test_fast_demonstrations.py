"""The fastest demonstrations that a campaign of ours asks for are recorded, although they hit harder than by hand."""

from rtstack.cells import default_cell_file
from rtstack.experiments.registry import plan_file
from rtstack.experiments.seeds import seed_of
from rtstack.papers.demonstrations import RECORDINGS, Bench, record
from rtstack.papers.reference import Reference
from rtstack.papers.reference_spreading.plan import load_plan


def test_what_the_sensitivity_campaign_asks_for_is_recorded(tmp_path):
    plan = load_plan(plan_file("reference-spreading-sensitivity").path)
    fastest = max(each.speed_m_s or 0.0 for each in plan.conditions.values())
    reference = Reference("rice_box", 0, fastest)
    assert reference in plan.references()
    bench = Bench(tmp_path, default_cell_file(), plan.criterion, "")
    (tmp_path / RECORDINGS).mkdir()
    seed = seed_of(plan.seed, "reference", reference.name)
    assert record(bench, reference, plan.conditions["nominal"], seed) is None
