"""--profile: how honest the simulated robot is, in each command that opens one, in the log and in a campaign."""

from dataclasses import replace
from pathlib import Path

import pytest

from rtstack.cells import open_cell, profile_of, with_profile
from rtstack.experiments.plan_file import digest_of
from rtstack.log.reader import read_log
from rtstack.papers.reference_spreading.plan import load_plan
from rtstack.papers.simulated_cell import plant_files
from rtstack.trials.errors import TrialError

PLAN = Path(__file__).parents[2] / "deploy" / "campaigns" / "reference-spreading.toml"


def test_a_trial_and_its_log_say_which_profile_runs(command_line, demonstration, tmp_path):
    log = tmp_path / "honest.mcap"
    asked = ["trial", "--reference", str(demonstration.path), "--profile", "honest", "--log", str(log), "--json"]
    assert command_line(*asked).returncode in (0, 1)
    assert read_log(log).metadata["trial"]["cell"] == "direct:honest"
    assert "direct:honest" in command_line("review", str(log)).stdout


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["--profile", "kind"], "unknown profile 'kind'; there is ideal, harsh, honest"),
        (["--profile", "honest", "--cell", "fci:127.0.0.11,127.0.0.12"], "give it to `rtstack sim`"),
        (["--profile", "honest", "--cell", "direct:harsh"], "--profile is for the cells direct, lockstep, realtime"),
    ],
)
def test_what_has_no_such_profile_is_refused_in_one_line(command_line, demonstration, tmp_path, asked, said):
    log = tmp_path / "never.mcap"
    refused = command_line("trial", "--reference", str(demonstration.path), "--log", str(log), *asked)
    assert refused.returncode == 2
    assert said in refused.stderr
    assert refused.stderr.count("\n") == 1
    assert not log.exists()


def test_the_ideal_profile_is_the_cell_without_one():
    assert with_profile("lockstep", "ideal") == with_profile("lockstep", None) == "lockstep"
    assert with_profile("lockstep", "harsh") == "lockstep:harsh"
    assert [profile_of(kind) for kind in ("direct", "realtime:honest", "fci:a,b")] == ["ideal", "honest", ""]
    cell = open_cell("direct:honest", "rice_box", 0.0, 0)
    assert cell.name == "direct:honest"
    cell.close()
    with pytest.raises(TrialError, match="behind its name stands its profile: unknown profile 'table-2'"):
        open_cell("direct:table-2", "rice_box", 0.0, 0)


def test_a_campaign_under_a_profile_is_another_campaign():
    whole = load_plan(PLAN)
    plan = replace(whole, conditions={"nominal": whole.conditions["nominal"]})
    honest = plan.under("honest")
    assert {one.profile for one in honest.conditions.values()} == {"honest"}
    assert digest_of(plan.under("ideal")) == digest_of(plan) != digest_of(honest)
    names = [path.name for path in plant_files(honest.conditions.values())]
    assert names == ["grab.toml", "plant.toml", "honest.toml"]
