"""A cell without a tracker: whether the object was held is told from the pads, and agrees with what really happened."""

import json
from dataclasses import replace

import pytest

from rtstack.cells import default_cell_file
from rtstack.log.reader import read_log
from rtstack.model.cell_description import base_poses, load_cell_description
from rtstack.model.tracker_description import NO_TRACKER
from rtstack.trials.review import log_columns
from rtstack.trials.scoring import SuccessCriterion, score

OBJECT = """
[objects.crate]
mass = 0.8
size = [0.16, 0.3, 0.22]
pad_friction = 0.5
"""


@pytest.mark.parametrize(
    ("plant", "held"),
    [
        ("mass = 0.8\n", True),
        ("mass = 0.8\npad_friction = 0.02\n", False),  # it slips out
        ("mass = 0.8\nsize = [0.16, 0.2, 0.22]\n", False),  # the pads meet nothing when they are expected to
    ],
)
def test_the_pads_tell_what_the_tracker_would(plant, held, tmp_path, command_line):
    file = tmp_path / "lab.toml"
    file.write_text(f"{default_cell_file().read_text()}{OBJECT}[objects.crate.plant]\n{plant}")
    options = ("--object", "crate", "--cell-file", file)
    assert command_line("plan", "crate.mcap", *options, cwd=tmp_path).returncode == 0
    done = command_line(
        "trial", "--reference", "crate.mcap", "--cell-file", file, "--log", "t.mcap", "--json", cwd=tmp_path
    )
    result = json.loads(done.stdout)
    assert (result["success"], result["object_observed"]) == (held, True), result
    log = read_log(tmp_path / "t.mcap")
    columns = log_columns(log)
    unseen = replace(columns, object=columns.object[:0])
    impact_s, trial = result["detected_impact_time_s"], log.metadata["trial"]
    arguments = (int(columns.arm[0]["t_ns"][0]), float(trial["nominal_impact_s"]), float(trial["release_s"]), impact_s)
    bases = base_poses(load_cell_description(file))
    told = score(unseen, *arguments, SuccessCriterion(), bases=bases, unobserved=True)
    assert (told.seen, told.by_pads, told.held, told.max_lift_mm) == (False, True, held, None)
    assert (
        score(unseen, *arguments, SuccessCriterion(), bases=bases).held is False
    )  # a tracker that sees nothing is no excuse


def test_a_cell_says_that_it_has_none(tmp_path):
    file = tmp_path / "lab.toml"
    file.write_text(default_cell_file().read_text().replace("[tracker]\n", '[tracker]\nkind = "none"\n'))
    assert load_cell_description(file).tracker.kind == NO_TRACKER
