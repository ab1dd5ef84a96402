"""The start pose of a cell: flat, clear of everything, by Pinocchio alone; and what is said where there is none."""

import re
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pinocchio as pin
import pytest

from hal.base.configuration import ConfigurationError, with_values
from rtstack.cells import default_cell_file
from rtstack.model.cell_description import CellDescription, base_frame, load_cell_description
from rtstack.planning.home import NoHome, find_home
from rtstack.safety.limits import hardware_limits

TEXT = default_cell_file().read_text()
HOMELESS = re.sub(r"(?m)^home = .*\n", "", TEXT)
IIWAS = Path(__file__).parents[2] / "examples" / "iiwa" / "iiwa" / "two_iiwas.toml"


def cell_with(folder: Path, values: dict[tuple[str, ...], object]) -> Path:
    path = folder / "cell.toml"
    path.write_text(with_values(HOMELESS, values))
    return path


def check_flat(description: CellDescription, homes: dict[str, np.ndarray], y: float, z: float) -> None:
    for side, q in homes.items():
        mounting = description.mountings[side]
        model = pin.buildModelFromXML(mounting.robot.urdf)
        data, frame = model.createData(), base_frame(mounting)
        pin.framesForwardKinematics(model, data, q)
        flange = pin.SE3(frame.rotation, frame.translation) * data.oMf[model.getFrameId("link8")]
        face, sign = flange * pin.SE3((mounting.pad or description.pad).F_T_face), 1.0 if side == "left" else -1.0
        np.testing.assert_allclose(face.translation, [0.0, sign * y, z], atol=1e-5)
        np.testing.assert_allclose(face.rotation[:, 2], [0.0, -sign, 0.0], atol=1e-5)
        limits = hardware_limits(mounting.robot)
        assert np.minimum(q - limits.q_lower, limits.q_upper - q).min() >= 0.1


def test_arms_start_where_those_of_the_shipped_cell_do(cell: CellDescription) -> None:
    homes = find_home(cell)
    assert list(homes) == ["left", "right"]
    check_flat(cell, homes, 0.35, 0.26)
    # as good as the file's own: the nearest limit, joint 4's, is as far away
    assert abs(homes["left"][3] - cell.arms[0].home[3]) < 0.01
    # mirror images, as the cell is
    np.testing.assert_allclose(homes["right"], homes["left"] * (-1, 1, -1, 1, -1, 1, -1), atol=5e-3)


def test_one_arm_has_a_start_too(cell: CellDescription) -> None:
    alone = cell.only(["right"])
    homes = find_home(alone)
    assert list(homes) == ["right"]
    check_flat(alone, homes, 0.35, 0.26)


def test_two_iiwas_start_flat_where_their_file_says() -> None:
    cell = load_cell_description(IIWAS)
    homes = find_home(cell)
    check_flat(cell, homes, 0.35, 0.29)  # 10 mm above the table their wrists would touch it
    for side, mounting in cell.mountings.items():
        np.testing.assert_allclose(homes[side], mounting.home, atol=1e-4)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({("left", "base_position"): [-1.5, 0.5, 0.0]}, "left arm: no start pose: out of reach"),
        ({("right", "base_position"): [-0.05, -0.2, 0.0]}, "right arm: no start pose: its links touch the table"),
        ({("safety", "ee_upper"): [0.2, 0.25, 0.75]}, "left arm: no start pose: the pad is outside of its box"),
        (
            {("safety", "q_upper"): [2.7, 1.7, 2.9, -2.9, 2.8, 4.5, 3.0]},
            "left arm: no start pose: joint 4 is at its limit",
        ),
        (
            {("left", "base_position"): [-0.4, 0.06, 0.0], ("right", "base_position"): [-0.4, -0.06, 0.0]},
            "no start pose: the arms come nearer than 0.05 m to each other",
        ),
    ],
)
def test_a_cell_without_a_start_says_why(tmp_path: Path, values: dict[tuple[str, ...], object], said: str) -> None:
    description = load_cell_description(cell_with(tmp_path, values), homeless=True)
    with pytest.raises(NoHome, match=rf"^{said}.*: move (its base|their bases)") as refused:
        find_home(description)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("line", ["", "home = [0, 0, 0, 0, 0, 0, 0]\n", "home = [0, 0, 0]\n"])
def test_a_bad_home_names_the_command(tmp_path: Path, line: str) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(re.sub(r"(?m)^home = .*\n", line, TEXT, count=1))
    with pytest.raises(ConfigurationError, match=rf"key left\.home.*; `rtstack home {path}` finds one$"):
        load_cell_description(path)


def test_the_command_says_and_writes_what_was_missing(
    tmp_path: Path, command_line: Callable[..., CompletedProcess[str]]
) -> None:
    path = cell_with(tmp_path, {("name",): "new"})
    before = path.read_text()
    said = command_line("home", path)
    assert said.returncode == 0, said.stderr
    assert re.fullmatch(r"\[left\]\nhome = \[.*\]\n\[right\]\nhome = \[.*\]\n", said.stdout)
    assert path.read_text() == before
    assert command_line("home", path, "--write").returncode == 0
    written = load_cell_description(path)
    check_flat(written, {side: np.array(arm.home) for side, arm in written.mountings.items()}, 0.35, 0.26)


def test_nothing_is_written_where_there_is_no_start(
    tmp_path: Path, command_line: Callable[..., CompletedProcess[str]]
) -> None:
    path = cell_with(tmp_path, {("left", "base_position"): [-1.5, 0.5, 0.0]})
    before = path.read_text()
    said = command_line("home", path, "--write")
    assert (said.returncode, said.stdout) == (2, "")
    assert said.stderr.startswith("rtstack: left arm: no start pose: out of reach")
    assert len(said.stderr.splitlines()) == 1
    assert path.read_text() == before
    assert [each.name for each in tmp_path.iterdir()] == ["cell.toml"]
