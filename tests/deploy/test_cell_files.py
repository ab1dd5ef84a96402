"""A cell's file: what is wrong in it is told with its line, and its gains reach the controller."""

from pathlib import Path

import numpy as np
import pytest

from hal.base.configuration import ConfigurationError
from rtstack.cells import default_cell_file
from rtstack.model.cell_description import load_cell_description
from rtstack.trials.assembly import cell_parameters, default_parameters

TEXT = default_cell_file().read_text()
LEFT = "base_position = [-0.4, 0.5, 0.0]"
UPRIGHT, XYZW, LONG = (
    f"base_orientation_wxyz = {q}" for q in ([1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [2.0, 0.0, 0.0, 0.0])
)


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('address = "127.0.0.11"', 'address = "a b"', "left.address"),
        ('address = "127.0.0.12"', 'address = "127.0.0.11"', "right.address"),
        ("base_position = [-0.4, -0.5, 0.0]", "base_position = [-0.4, -0.5]", "right.base_position"),
        ("base_position = [-0.4, 0.5, 0.0]", "base_position = [-0.4, 0.5, nan]", "left.base_position"),
        ("base_position = [-0.4, -0.5, 0.0]", "base_position = [-0.4, inf, 0.0]", "right.base_position"),
        ("home = [-0.301958, 0.089107", "home = [-0.301958, 1.8", "left.home"),
        ("size = [0.1, 0.1, 0.03]", "size = [0.1, 0.0, 0.03]", "pad.size"),
        ("mass = 0.35", "mass = -0.35", "pad.mass"),
        ("mass = 2.12", "mass = -2.12", "objects.bottles.mass"),
        ("[objects.bottles]", "[objects.none]", "objects.none"),
        ("size = [0.2, 0.27, 0.23]", "size = [0.2, -0.27, 0.23]", "objects.bottles.size"),
        ("ee_speed_max = 1.0", "ee_speed_max = 9.0", "safety.ee_speed_max"),
        ("power_max = 100.0", "power_maximum = 100.0", "safety.power_maximum"),
        ("ee_lower = [-0.2, -0.4, 0.25]", "ee_lower = [0.0, 0.0]", "safety.ee_lower"),
        ("cutoff_hz = 0.0", "cutoff = 0.0", "torque_filter.cutoff"),
        ("cutoff_hz = 0.0", "cutoff_hz = -1.0", "torque_filter.cutoff_hz"),
        ('address = "127.0.0.1:1341"', 'address = "127.0.0.1"', "tracker.address"),
        ("place_tolerance_m = 0.06", "place_tolerance_m = 0.0", "tracker.place_tolerance_m"),
        ("speed_rad_s = 0.4", "speed_rad_s = 4.0", "start_motion.speed_rad_s"),
        ("speed_rad_s = 0.4", "speed_rad_s = nan", "start_motion.speed_rad_s"),
        ("longest_rad = 1.5", "longest_rad = 0", "start_motion.longest_rad"),
        # what can hardly be meant: in mm or g, in another order, of the other arm
        ("base_position = [-0.4, 0.5, 0.0]", "base_position = [-400.0, 500.0, 0.0]", "left.base_position"),
        (f"{LEFT}\n{UPRIGHT}", f"{XYZW}\n{LEFT}", "left.base_position"),
        (f"{LEFT}\n{UPRIGHT}", f"{LEFT}\n{LONG}", "left.base_orientation_wxyz"),
        ("base_position = [-0.4, -0.5, 0.0]", "base_position = [-0.4, 0.52, 0.0]", "right.base_position"),
        ("base_position = [-0.4, 0.5, 0.0]", "base_position = [-0.4, -0.9, 0.0]", "left.base_position"),
        ("base_position = [-0.4, 0.5, 0.0]", "base_position = [-0.4, 0.5, -0.3]", "left.base_position"),
        ("top_z = 0.2", "top_z = 200.2", "table.top_z"),
        *(
            ("top_z = 0.2", f"top_z = {z}", "table.top_z")
            for z in ("-1", "-0.9", "1.5", "nan", "-inf", "1e400", "9" * 400)
        ),
        *(("power_max = 100.0", f"power_max = {x}", "safety.power_max") for x in ("8" * 400, "inf", "nan", '"1,5"')),
        ("ee_speed_max = 1.0", f"ee_speed_max = 1{'0' * 400}", "safety.ee_speed_max"),
        ("[tracker]", "[tracker]\nposition = [620.0, 0.0, 0.0]", "tracker.position"),
        ("mass = 0.35", "mass = 0.35\noffset_xy = [3.0, 0.0]", "pad.offset_xy"),
        ("flange_to_face = 0.03", "flange_to_face = nan", "pad.flange_to_face"),
        (f"{LEFT}\n{UPRIGHT}", f"{LEFT}\nbase_orientation_wxyz = [0.9, 0.1, 0.0, 0.0]", "left.base_orientation_wxyz"),
        ("mass = 0.35", "mass = 350.0", "pad.mass"),
        ("mass = 0.35", "mass = 0.0", "pad.mass"),
        ("size = [0.1, 0.1, 0.03]", "size = [100.0, 0.1, 0.03]", "pad.size"),
        ("mass = 2.12", "mass = 2120.0", "objects.bottles.mass"),
        ("size = [0.2, 0.27, 0.23]", "size = [200.0, 0.27, 0.23]", "objects.bottles.size"),
        ("ee_lower = [-0.2, -0.4, 0.25]", "ee_lower = [-200.0, -400.0, 250.0]", "safety.ee_lower"),
        ("[tracker]", "[gains]\nstiffness = [9000.0, 1, 1, 1, 1, 1]\n[tracker]", "gains.stiffness"),
        ("[tracker]", '[gains]\nlaw_inertia = "m"\n[tracker]', "gains.law_inertia"),
    ],
)
def test_what_is_wrong_has_its_line_key_and_reason(tmp_path, old, new, key):
    assert TEXT.count(old) == 1
    path = tmp_path / "cell.toml"
    path.write_text(TEXT.replace(old, new))
    last = new.splitlines()[-2 if "[gains]" in new else -1]
    places = [k for k, text in enumerate(path.read_text().splitlines(), 1) if last in text and not text.startswith("#")]
    line = places[-1 if "address" in key and "11" in new else 0]  # the second of two that are the same
    with pytest.raises(ConfigurationError) as refused:
        load_cell_description(path)
    said = str(refused.value)
    assert said.startswith(f"{path}:{line}: key {key}")
    assert "\n" not in said
    assert len(said) > len(f"{path}:{line}: key {key}") + 5


SAFETY = TEXT[TEXT.index("[safety]") : TEXT.index("[tracker]")]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name = 'a'\nsimulated = maybe\n", r":2: not valid TOML"),
        ("name = 'a'\nname = 'b'\n", r":2: not valid TOML"),
        (TEXT.replace("[pad]", "[paddle]"), r"(:\d+)?: key pad"),  # it is nowhere
        (f"safety = 3\n{TEXT.replace(SAFETY, '')}", r":1: key safety: "),
    ],
    ids=["no TOML", "twice", "missing", "no table"],
)
def test_what_is_no_table_has_its_line_too(tmp_path, text, said):
    path = tmp_path / "cell.toml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=rf"cell\.toml{said}"):
        load_cell_description(path)


def test_the_cells_gains_count_and_nothing_else_changes(tmp_path: Path):
    path = tmp_path / "cell.toml"
    path.write_text(TEXT.replace("[tracker]", "[gains]\nstiffness = [1500, 1400, 1300, 15, 14, 13]\n[tracker]"))
    control, published = (p.control for p in (cell_parameters(load_cell_description(path)), default_parameters()))
    np.testing.assert_array_equal(control.stiffness, [1500.0, 1400.0, 1300.0, 15.0, 14.0, 13.0])
    np.testing.assert_array_equal(control.stiffness_teleoperation, published.stiffness_teleoperation)
    assert control.posture_gain == published.posture_gain
    plain = cell_parameters(load_cell_description(default_cell_file())).control
    np.testing.assert_array_equal(plain.stiffness, published.stiffness)


def test_a_quaternion_s_length_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"left\.base_orientation_wxyz: .*not one of norm 2"):
        load_cell_description(written(tmp_path, TEXT.replace(UPRIGHT, LONG, 1)))


def written(folder: Path, text: str) -> Path:
    (folder / "cell.toml").write_text(text, encoding="utf-8")
    return folder / "cell.toml"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (".".join(["a"] * 50_000) + " = 1\n" + TEXT, r"cell\.toml:1: not valid TOML: a key has more than 32"),
        (TEXT + "\n[" + ".".join(['"a b"'] * 50_000) + "]\n", r"cell\.toml:\d+: .*a key has more than 32"),
        ("x = {" + " . ".join(["b"] * 50_000) + " = 1}\n" + TEXT, r"cell\.toml:1: not valid TOML: a key has more than"),
        ("x = " + "[" * 50_000, "recursion"),
        ("#" * 5_000_000 + TEXT, "larger than 4 MB"),
        (TEXT.replace('name = "grab"', f'name = "grab"\nnote = "{"x" * 100_000}"'), "key note"),
        (TEXT.replace('name = "grab"', f'name = "grab"\n{"k" * 100_000} = 1'), r"key kkk.*\.\.\.k+: "),
        (TEXT.replace("power_max = 100.0", f'power_max = "{"9" * 100_000}"'), r"safety\.power_max"),
        (TEXT.replace("top_z = 0.2", "top_z = 0,2"), r"cell\.toml:\d+: .*; 0,2 has a decimal comma: write 0\.2"),
        (TEXT.replace(LEFT, "base_position = [-0,4, 0,5, 0,0]"), r"base_position: .*; -0,4 has a decimal comma"),
    ],
)  # fmt: skip
def test_a_file_of_any_size_is_refused_in_one_short_line(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(ConfigurationError, match=complaint) as caught:
        load_cell_description(written(tmp_path, text))
    assert len(str(caught.value)) < 800
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("change", [lambda text: "\ufeff" + text, lambda text: text.replace("\n", "\r\n")])
def test_a_byte_order_mark_and_line_ends_change_nothing(tmp_path: Path, change) -> None:
    assert load_cell_description(written(tmp_path, change(TEXT))) == load_cell_description(written(tmp_path, TEXT))
