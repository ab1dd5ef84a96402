"""Commands on a cell of one arm, the right one: nothing of the left one is in what they write, draw or ask for."""

import json
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from rtstack.cells import load_description
from rtstack.datasets.export import export
from rtstack.datasets.hdf5 import Hdf5
from rtstack.datasets.lerobot import LeRobot, plain
from rtstack.datasets.lerobot_import import import_episode
from rtstack.datasets.zarr import Zarr
from rtstack.figures.log_data import figure_log
from rtstack.figures.log_figure import panes_of
from rtstack.identification import sweep
from rtstack.log.analysis.signals import DEFAULT, matching, signals
from rtstack.log.reader import read_log
from rtstack.planning import PushPlan, plan_push
from rtstack.planning.file import write_plan
from rtstack.trials.errors import TrialError
from rtstack.trials.specification import TrialSpecification
from rtstack.trials.trial import prepare_trial
from sim_robot.profile import load_profile
from tests.support.made_once import made_once
from tests.support.one_arm import one_arm_file
from tests.support.runs import attempt

COMMAND = Path(sys.executable).with_name("rtstack")
SIDE, OTHER = "right", "left"


@dataclass(frozen=True, slots=True)
class Pushed:
    """A cell's file of one arm, a push that was planned for it, and the log of its trial."""

    cell: Path
    plan: Path
    log: Path
    success: bool


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Pushed:
    """The right arm pushes the lightest box."""

    def make(folder: Path) -> Pushed:
        file = one_arm_file(folder, SIDE)
        cell, name = load_description(file)[0], "box_060"
        write_plan(folder / "push.mcap", plan_push(cell, name, PushPlan()), cell, file)
        asked = TrialSpecification(str(folder / "push.mcap"), object=name)
        result = attempt(asked, cell, folder / "trial.mcap", file=file)
        return Pushed(file, folder / "push.mcap", folder / "trial.mcap", result.success)

    return made_once(tmp_path_factory, "one_arm", make)


def test_the_only_arm_pushes_and_its_log_has_no_other(pushed):
    assert pushed.success
    for path in (pushed.plan, pushed.log):
        log = read_log(path)
        assert log.sides == (SIDE,)
        assert not [topic for topic in log.topics if OTHER in topic and log.count(topic)]
    measured = read_log(pushed.log).topic("/right/arm")["O_F_ext_hat_K"]
    assert np.abs(measured).max() > 10.0


def test_review_plot_and_replay_say_what_the_arm_did(pushed, tmp_path, command_line):
    found = json.loads(command_line("review", pushed.log, "--json").stdout)
    assert (found["sides"], len(found["first_contact_s"])) == ([SIDE], 1)
    assert OTHER not in command_line("review", pushed.log).stdout.replace("left out", "")
    replayed = json.loads(command_line("replay", pushed.log, "--json").stdout)
    assert replayed["same"]
    refused = command_line("plot", pushed.log, "left.tau_J", cwd=tmp_path)
    assert (refused.returncode, refused.stderr) == (2, "rtstack: trial: it has no samples of these signals\n")
    done = command_line("plot", pushed.log, "--output", tmp_path / "shown.png")
    assert done.returncode == 0, done.stderr


def test_a_figure_has_the_curves_of_the_arm_alone(pushed):
    log = figure_log(pushed.log, [signals()[name] for name in DEFAULT] + matching(["force_norm"]))
    labels = [line.label for pane in panes_of([log]) for line in pane.lines]
    assert labels
    assert all(SIDE in label for label in labels)  # also of what two arms share


@pytest.mark.long
def test_a_film_of_the_log_shows_the_cell_with_its_arm(pushed, tmp_path):
    shown = tmp_path / "shown.webp"
    # in a process of its own: MuJoCo chooses how it draws when it is imported
    words = ("plot", pushed.log, "--from", "1.5", "--to", "1.52", "--output", shown)
    subprocess.run([COMMAND, *map(str, words)], check=True, capture_output=True)
    with Image.open(shown) as picture:
        assert picture.n_frames > 1


def test_data_sets_have_the_values_of_the_arm_alone_and_become_a_log_again(pushed, tmp_path):
    h5py, zarr = pytest.importorskip("h5py"), pytest.importorskip("zarr")
    arm = read_log(pushed.log).topic("/right/arm")
    export([pushed.log], tmp_path / "frames", LeRobot())
    table = pq.read_table(tmp_path / "frames" / "data")
    at = 20 * np.arange(1, len(table) + 1) - 1
    assert plain(table, "observation.state").tobytes() == np.hstack([arm[name][at] for name in ("q", "dq")]).tobytes()
    assert plain(table, "action").shape == (len(table), 7)
    features = json.loads((tmp_path / "frames" / "meta" / "info.json").read_text())["features"]
    assert not [name for each in features.values() for name in each.get("names") or () if name.startswith(OTHER)]
    tasks = pq.read_table(tmp_path / "frames" / "meta" / "tasks.parquet").to_pylist()
    assert "hit-and-push the box 060 with the right arm" in str(tasks)
    import_episode(tmp_path / "frames", 0, tmp_path / "back.mcap")
    back = read_log(tmp_path / "back.mcap")
    assert back.sides == (SIDE,)
    assert back.topic("/right/arm")["q"].tobytes() == arm["q"][: 20 * len(table)].tobytes()
    export([pushed.log], tmp_path / "all.h5", Hdf5())
    with h5py.File(tmp_path / "all.h5") as file:
        (recording,) = file.values()
        assert {name for name in recording["SENSOR_MEASUREMENT"] if "arm" in name} == {"right_arm"}
    export([pushed.log], tmp_path / "all.zarr", Zarr())
    assert zarr.open(str(tmp_path / "all.zarr"))["data"]["action"].shape == (len(table), 7)


def test_a_log_that_was_cut_off_is_recovered(pushed, tmp_path, command_line):
    (tmp_path / "cut.mcap").write_bytes(pushed.log.read_bytes()[:300_000])
    done = command_line("recover", tmp_path / "cut.mcap")
    assert done.returncode == 0, done.stderr
    assert read_log(tmp_path / "cut.recovered.mcap").sides == (SIDE,)


@pytest.mark.parametrize("kind", ["direct", pytest.param("lockstep", marks=pytest.mark.long)])
def test_the_log_is_played_on_the_arm(pushed, tmp_path, command_line, kind):
    words = ("play", pushed.log, "--cell", kind, "--cell-file", pushed.cell, "--log", tmp_path / "played.mcap")
    done = command_line(*words, "--json")
    assert done.returncode == 0, done.stderr
    assert read_log(tmp_path / "played.mcap").sides == (SIDE,)


def test_what_takes_two_arms_or_the_other_one_is_refused_in_one_line(pushed, demonstration, tmp_path, command_line):
    one, other = ("--cell-file", pushed.cell), ("--cell-file", one_arm_file(tmp_path, OTHER))
    for words, said in (
        (("plan", "out.mcap", *one), "a grab takes two arms, and the cell grab has the right one alone"),
        (("teach", "out.mcap", *one), "takes two arms, and the cell grab has the right one alone"),
        (("trial", "--reference", demonstration.path, *one),
         "it is of the left and the right arms, and the cell has the right arm: follow one of the same arms"),
        (("trial", "--reference", pushed.plan), "it is of the right arm, and the cell has the left and the right arms"),
        (("trial", "--reference", pushed.plan, *other), "it is of the right arm, and the cell has the left arm"),
        (("play", pushed.log), "it has no samples of the left arm: there is nothing to play"),
        (("tune-monitor", *[pushed.log] * 6, "--out", "tuning.toml", *one), "a monitor takes two arms"),
        (("teach", "a.mcap", "--cell", "fci:127.0.0.11"), "takes two arms, and the cell grab has the left one alone"),
        (("twin", pushed.log, "--out", "twin", *other), "it has no samples of the left arm: it says nothing about it"),
    ):  # fmt: skip
        done = command_line(*words, cwd=tmp_path)
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), words
        assert said in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["left.toml"]


@pytest.mark.long
def test_the_arms_excitation_becomes_its_twin_and_its_friction(tmp_path, command_line, monkeypatch):
    monkeypatch.setattr(sweep, "TONES_S", 4.0)  # 18 s otherwise
    file, log, out = one_arm_file(tmp_path, SIDE), tmp_path / "excited.mcap", tmp_path / "twin"
    assert command_line("excite", log, "--cell-file", file).returncode == 0
    said = command_line("twin", log, "--out", out, "--cell-file", file)
    assert said.returncode == 0, said.stderr
    assert OTHER not in said.stdout
    assert "contact_stiffness" not in said.stdout  # a squeeze takes two pads
    assert OTHER not in json.loads((out / "twin.json").read_text())
    for name in ("profile.toml", "friction.toml"):
        text = (out / name).read_text()
        assert f"[{SIDE}]" in text
        assert f"[{OTHER}]" not in text
    profile = load_profile(str(out / "profile.toml"))
    assert profile.right.B_theta is not None
    words = ("--profile", out / "profile.toml", "--cell-file", out / "cell.toml")
    again = command_line("excite", tmp_path / "again.mcap", *words)
    assert again.returncode == 0, again.stderr


def test_the_link_of_the_arm_is_measured(pushed, command_line):
    done = command_line("bench", "link", "--ticks", "250", "--cell-file", pushed.cell, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert len(found["success_rate_mean"]) == len(found["hold_rad"]) == 1


def test_the_shipped_cell_of_one_arm_pushes(tmp_path, command_line):
    shutil.copy(str(files("deploy.cells") / "one_arm.toml"), tmp_path / "cell.toml")
    words = ("plan", "push.mcap", "--motion", "hit-and-push", "--cell-file", "cell.toml")
    done = command_line(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[1].split()[0] == "left"
    cell = load_description(tmp_path / "cell.toml")[0]
    prepare_trial(TrialSpecification(str(tmp_path / "push.mcap")), cell)
    with pytest.raises(TrialError, match="unknown object"):
        prepare_trial(TrialSpecification(str(tmp_path / "push.mcap"), object="parcel"), cell)
