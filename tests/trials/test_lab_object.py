"""A lab's own object on the command line: planned, taught and grabbed from the cell's file, wherever it stands."""

import json
from pathlib import Path

import pytest

from rtstack.cells import default_cell_file, open_cell
from rtstack.cli.app import app, whole
from rtstack.live.source import live_source
from rtstack.log.reader import read_log
from rtstack.model.cell_description import load_cell_description
from rtstack.planning import GrabPlan, PlanError, plan_grab
from rtstack.trials.errors import TrialError

CRATE = """
[objects.crate]
mass = 0.8
size = [0.16, 0.3, 0.22]
pad_friction = 0.5
"""
HEAVIER = CRATE + "[objects.crate.plant]\nmass = 0.9\n"
SHIFTED = ("--displacement-x-mm", 10, "--displacement-mm=-20", "--yaw-deg", 5)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the cell's file of a lab, lab.toml, and one whose simulated crate is heavier."""
    folder = tmp_path_factory.mktemp("lab")
    for name, text in (("lab", CRATE), ("heavier", HEAVIER)):
        (folder / f"{name}.toml").write_text(default_cell_file().read_text() + text)
    app(["plan", str(folder / "crate.mcap"), "--object", "crate", "--cell-file", str(folder / "lab.toml")],
        standalone_mode=False)  # fmt: skip
    return folder


@pytest.mark.long
def test_it_is_taught_and_grabbed_with_the_same_option(lab, tmp_path, command_line):
    file = ("--cell-file", lab / "lab.toml")
    taught = command_line("teach", "ref.mcap", "--object", "crate", *file, cwd=tmp_path)
    assert (taught.returncode, taught.stderr) == (0, "")
    for reference in ("ref.mcap", lab / "crate.mcap"):
        done = command_line("trial", "--reference", reference, *file, *SHIFTED, "--json", cwd=tmp_path)
        result = json.loads(done.stdout)
        assert (done.returncode, result["success"], result["object"]) == (0, True, "crate"), result
        assert [result[key] for key in ("displacement_mm", "displacement_x_mm", "yaw_deg")] == [-20.0, 10.0, 5.0]


def test_a_mass_that_differs_is_said_at_the_start_and_in_the_log(lab, tmp_path, command_line):
    arguments = ("trial", "--reference", lab / "crate.mcap", "--log", "t.mcap", "--cell-file", lab / "heavier.toml")
    done = command_line(*arguments, cwd=tmp_path)
    said = "the plant's crate is not what the cell's file describes: mass 0.9 kg (the controller: 0.8 kg)"
    assert done.stderr.splitlines().count(f"rtstack: warning: {said}") == 1
    events = read_log(tmp_path / "t.mcap").events
    assert [event.text for event in events if event.name == "cell"] == [said]


def test_no_controller_learns_where_it_stands(lab, tmp_path, command_line):
    """The commanded torques are the same, bit for bit, until a pad meets the object."""
    logs = []
    for name, shift in (("plain", ()), ("shifted", SHIFTED)):
        arguments = ("--reference", lab / "crate.mcap", "--cell-file", lab / "lab.toml", "--log", f"{name}.mcap")
        assert command_line("trial", *arguments, *shift, cwd=tmp_path).returncode == 0
        logs.append(read_log(tmp_path / f"{name}.mcap"))
    torques = [log.topic("/left/arm")["tau_desired"] for log in logs]
    met = min(float(log.metadata["result"]["detected_impact_time_s"]) for log in logs)
    before = round(1e3 * met) - 100
    assert before > 500
    assert (torques[0][:before] == torques[1][:before]).all()
    assert not (torques[0][: len(torques[1])] == torques[1][: len(torques[0])]).all()


def test_every_command_that_handles_objects_names_the_file_alike():
    commands = whole().commands
    for name in ("plan", "teach", "trial", "sim", "up", "campaign", "play", "check", "robot", "console"):
        options = {word: option for option in commands[name].params for word in option.opts}
        assert options["--cell-file"].name == "cell_file", name
        if name in ("up", "robot", "console"):  # the contract's name, and what unit files have
            assert options["--cell"].hidden
        elif name in ("teach", "trial", "play"):  # the kind of cell
            assert options["--cell"].default == "direct"
        elif name == "campaign":  # the kind of cell, where the campaign has a choice
            assert options["--cell"].default is None
        else:
            assert "--cell" not in options


def test_its_friction_counts_in_plans(lab):
    description = load_cell_description(lab / "lab.toml")
    plan_grab(description, "crate", GrabPlan())
    with pytest.raises(PlanError, match=r"friction 0\.5 does not hold crate"):
        plan_grab(description, "crate", GrabPlan(squeeze=12.0))


def test_an_unknown_object_says_where_to_define_it(lab, tmp_path, command_line):
    for arguments in (("plan", "new.mcap"), ("teach", "new.mcap"), ("trial", "--reference", lab / "crate.mcap")):
        done = command_line(*arguments, "--object", "anvil", cwd=tmp_path)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert "[objects.anvil]" in done.stderr
        assert "--cell-file" in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_mistake_in_the_plants_part_is_found_before_anything_is_opened(lab, tmp_path, command_line):
    file = tmp_path / "wrong.toml"
    file.write_text(default_cell_file().read_text() + CRATE + "[objects.crate.plant]\nstiff = 1.0\n")
    done = command_line("teach", "new.mcap", "--object", "crate", "--cell-file", file, cwd=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "objects.crate.plant: key stiff" in done.stderr
    with pytest.raises(TrialError, match="key stiff"):
        live_source(file)
    assert list(tmp_path.iterdir()) == [file]


def test_a_served_robot_has_it_too(lab):
    opened = open_cell("lockstep", "crate", 0.0, 0, load_cell_description(lab / "heavier.toml"),
                       cell_file=lab / "heavier.toml")  # fmt: skip
    opened.close()
    assert "mass 0.9 kg" in opened.warning
