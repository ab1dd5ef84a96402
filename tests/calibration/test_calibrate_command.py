"""`rtstack calibrate`: points from a file or from arms that are led, and the cell's file that it changes."""

import json
import tomllib
from datetime import date

import numpy as np
import pytest

from hal.base.configuration import with_values
from rtstack.calibration.points import Point, load_points, save_points
from rtstack.cells import default_cell_file, load_description
from tests.support.one_arm import one_arm_file
from tests.support.wrong_cell import Wrongness, built, touched_points

CELL = load_description(None)[0]


def wrong_cell(seed: int):
    return built(CELL, np.random.default_rng(seed), Wrongness(pad_m=0.0))


@pytest.fixture
def cell_file(tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(default_cell_file().read_text())
    return path


def test_the_result_is_written_into_the_cells_file_and_nothing_else_of_it_changes(tmp_path, cell_file, command_line):
    real = wrong_cell(0)
    points, bases = touched_points(CELL, real, 3e-4), real.bases
    save_points(tmp_path / "points.toml", points)
    before = cell_file.read_text()
    looked = command_line("calibrate", "points.toml", "--cell-file", "cell.toml", cwd=tmp_path)
    assert looked.returncode == 0, looked.stderr
    assert "nothing is written" in looked.stdout
    assert cell_file.read_text() == before
    done = command_line("calibrate", "points.toml", "--cell-file", "cell.toml", "--write", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    description = load_description(cell_file)[0]
    assert description.left.base_position == tuple(found["values"]["left.base_position"])
    assert np.abs(np.array(description.right.base_position) - bases[1][:3, 3]).max() < 2e-3
    assert description.calibration.date == date.today()
    assert description.calibration.uncertainty_mm == pytest.approx(found["uncertainty_mm"], abs=0.01)
    changed = set(cell_file.read_text().splitlines()) ^ set(before.splitlines())
    assert {line.split(" = ")[0] for line in changed} == {
        "base_position", "base_orientation_wxyz", "[calibration]", "date", "valid_days", "rms_mm", "uncertainty_mm",
        "points",
    }  # fmt: skip
    again = command_line("calibrate", "points.toml", "--cell-file", "cell.toml", "--write", cwd=tmp_path)
    assert again.returncode == 0
    assert cell_file.read_text().count("\n[calibration]\n") == 1


def test_what_is_too_coarse_is_not_written(tmp_path, cell_file, command_line):
    points = touched_points(CELL, wrong_cell(1), 4e-3)
    save_points(tmp_path / "points.toml", points)
    before = cell_file.read_text()
    done = command_line("calibrate", "points.toml", "--cell-file", "cell.toml", "--write", cwd=tmp_path)
    assert done.returncode == 1
    assert "above 3 mm, not used" in done.stderr
    assert cell_file.read_text() == before


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[points.a]\nwhat = "poke"\n', "key points.a.what"),
        ("[points.a]\nplace = [0.0, 0.0]\n", "key points.a.place"),
        ("[points.a]\n", "key points.a: a point to touch needs its place"),
        ("points = {}\n", "key points"),
        ("[points.a]\nplace = [0.0, 0.0, 0.3]\n", "a still to be measured: name the arms with --cell"),
        (f"[points.a]\nplace = [0.0, 0.0, 0.3]\nq_left = {[0.0] * 7}\nq_right = {[0.0] * 7}\n", "1 points are too few"),
    ],
)
def test_points_that_cannot_be_used_are_one_line(tmp_path, command_line, text, words):
    (tmp_path / "points.toml").write_text(text)
    done = command_line("calibrate", "points.toml", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert words in done.stderr


@pytest.mark.long
def test_arms_that_are_led_are_measured_and_what_was_measured_is_kept(tmp_path, cell_file, command_line):
    points = {name: Point("touch", name, (0.0, 0.1, 0.3)) for name in ("left", "right")}
    points["rest"] = Point("rest")
    save_points(tmp_path / "points.toml", points)
    done = command_line("calibrate", "points.toml", "--cell", "direct", "--seconds", "0.2", cwd=tmp_path)
    assert done.returncode == 2
    assert "2 points are too few for left base, right base" in done.stderr
    assert "point 2 of 3, right: touch x 0.0000, y 0.1000, z 0.3000 m" in done.stderr
    kept = load_points(tmp_path / "points.toml")
    assert all(point.measured(CELL.sides) for point in kept.values())
    np.testing.assert_allclose(kept["right"].q_left, CELL.left.home, atol=0.02)
    assert np.abs(kept["rest"].tau_left).max() < 1.0


@pytest.mark.parametrize("side", CELL.sides)
def test_of_a_cell_of_one_arm_only_its_joints_are_asked_for_and_written(tmp_path, command_line, side):
    cell = CELL.only((side,))
    file = one_arm_file(tmp_path, side)
    points = touched_points(cell, built(cell, np.random.default_rng(0), Wrongness(pad_m=0.0)), 3e-4)
    points["rest"] = Point("rest")
    save_points(tmp_path / "points.toml", points)
    words = ("calibrate", "points.toml", "--cell-file", file)
    done = command_line(*words, "--cell", "direct", "--seconds", "0.1", "--write", "--json", cwd=tmp_path)
    # three postures at rest are needed for the payload; nothing of the other arm was asked for
    assert (done.returncode, done.stderr.count("\n")) == (2, 2)
    assert "the payload" in done.stderr or "postures" in done.stderr
    kept = load_points(tmp_path / "points.toml")
    other = CELL.sides[1 - CELL.sides.index(side)]
    assert all(point.measured((side,)) and point.q(other) is None is point.tau(other) for point in kept.values())
    del kept["rest"]
    save_points(tmp_path / "points.toml", kept)
    done = command_line(*words, "--write", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert {key.split(".")[0] for key in json.loads(done.stdout)["values"]} == {side, "calibration"}
    assert load_description(file)[0].sides == (side,)


def test_pads_that_are_to_meet_are_refused_before_an_arm_is_led(tmp_path, command_line):
    save_points(tmp_path / "points.toml", {"pads": Point("meet")})
    file = one_arm_file(tmp_path, "right")
    done = command_line("calibrate", "points.toml", "--cell", "direct", "--cell-file", file, cwd=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "points.toml: pads: two pads cannot meet, grab has one arm, right: remove the point" in done.stderr


def test_a_wiggle_turns_one_joint_of_one_arm(tmp_path, command_line):
    done = command_line("wiggle", "right", "--joint", "7", "--cell", "direct", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "joint 7 of the right arm has turned by a degree and back" in done.stdout
    assert command_line("wiggle", "middle", cwd=tmp_path).returncode == 2


def test_values_replace_those_of_a_file_and_leave_the_rest():
    text = 'name = "a" # its name\n[t]\nlist = [1,\n  2] # two\n\n[t.u]\nx = 1\n'
    changed = with_values(text, {("name",): "b", ("t", "list"): [3], ("t", "y"): 2.5, ("v", "d"): date(2026, 1, 2)})
    assert tomllib.loads(changed) == {
        "name": "b", "t": {"y": 2.5, "list": [3], "u": {"x": 1}}, "v": {"d": date(2026, 1, 2)}
    }  # fmt: skip
    assert "# its name" in changed
    assert "# two" in changed
