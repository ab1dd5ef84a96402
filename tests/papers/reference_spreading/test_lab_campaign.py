"""A campaign about a lab's own object, shifted and turned, with the cell's file given by the option of all commands."""

import csv

import pytest

from rtstack.cells import default_cell_file
from rtstack.cli.campaign import campaign
from rtstack.log.reader import read_log
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
