"""A campaign about a lab's own object, shifted and turned; and the fastest demonstrations that one of ours asks for."""

import csv

import pytest

from rtstack.cells import default_cell_file
from rtstack.cli.campaign import campaign
from rtstack.experiments.experiment import Request
from rtstack.experiments.registry import plan_file
from rtstack.experiments.seeds import seed_of
from rtstack.log.reader import read_log
from rtstack.papers.conditions import RECORDINGS, Reference
from rtstack.papers.demonstrations import Bench, record
from rtstack.papers.reference_spreading.experiment import ControllerComparison
from rtstack.papers.reference_spreading.plan import load_plan
from rtstack.trials.errors import TrialError

CRATE = """
[objects.crate]
mass = 0.8
size = [0.16, 0.3, 0.22]
[objects.crate.plant]
mass = 0.85
pad_friction = 0.6
"""
PLACES = "displacements_mm = [-20.0]\ndisplacements_x_mm = [10.0]\nyaws_deg = [5.0]\n"


@pytest.fixture
def files(command, tmp_path):
    """Return a plan about the crate, and the cell's file that has it."""
    plan, cell = tmp_path / "crate.toml", tmp_path / "lab.toml"
    text = command.plan.read_text().replace("rice_box/0", "crate/0")
    assert "displacements_mm = [-30.0]\n" in text
    plan.write_text(text.replace("displacements_mm = [-30.0]\n", PLACES))
    cell.write_text(default_cell_file().read_text() + CRATE)
    return plan, cell


@pytest.mark.long
def test_it_runs_and_says_where_the_plant_differs(command, files, tmp_path):
    plan, cell = files
    done = type(command)(plan).run(tmp_path / "out", "--workers", "1", "--cell-file", str(cell))
    assert done.returncode == 0, done.stderr
    assert "mass 0.85 kg (the controller: 0.8 kg)" in done.stderr
    rows = list(csv.DictReader((tmp_path / "out" / "results.csv").read_text().splitlines()))
    assert len(rows) == 5
    for row in rows:
        assert (row["object"], row["displacement_x_mm"], row["yaw_deg"]) == ("crate", "10.0", "5.0")
        assert "+10mmx+5deg" in row["id"]
    assert rows[0]["success"] == "True"
    log = read_log(tmp_path / "out" / rows[0]["log"])
    first = log.topic("/object/pose")[0]["position"]
    assert abs(first[0] - 0.01) < 5e-3
    assert abs(first[1] + 0.02) < 5e-3


def test_an_object_that_the_cell_lacks_and_a_study_of_its_own_cell_are_refused(files, tmp_path):
    plan, cell = files
    with pytest.raises(TrialError, match=r"unknown object 'crate'.*--cell-file"):
        campaign(str(plan), tmp_path / "out", False, 1, None, False)
    with pytest.raises(TrialError, match="--cell-file: aim-aware-grab takes none"):
        campaign("aim-aware-grab", tmp_path / "out", False, 1, None, False, cell_file=cell)
    assert not (tmp_path / "out").exists()


def test_what_the_sensitivity_campaign_asks_for_is_recorded(tmp_path):
    plan = load_plan(plan_file("reference-spreading-sensitivity").path)
    fastest = max(plan.conditions, key=lambda name: plan.conditions[name].speed_m_s or 0.0)
    reference = Reference("rice_box", 130, fastest)
    assert reference in plan.references()
    bench = Bench(tmp_path, "direct", default_cell_file(), "", plan.criterion)
    (tmp_path / RECORDINGS).mkdir()
    seed = seed_of(plan.seed, "reference", reference.name)
    assert record(bench, reference, plan.conditions[fastest], seed) is None


def test_trials_of_a_reference_that_cannot_be_recorded_are_left_out(tmp_path):
    file = plan_file("reference-spreading-sensitivity")
    campaign = ControllerComparison(load_plan(file.path), Request(file, tmp_path))
    size, fast = campaign.size(), "rice_box/130@fast"
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
    with pytest.raises(TrialError, match="rice_box/130 could not be recorded: broken"):
        stages.send(dict.fromkeys(recorded, "broken"))
