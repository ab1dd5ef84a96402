"""A lab's own objects: the plant's values come from the cell's file, each of them the lab's to change."""

import re
from pathlib import Path

import mujoco
import pytest

from hal.base.configuration import ConfigurationError
from sim_robot.cell import simulated_cell
from sim_robot.lab_objects import WALLS, difference, with_lab_objects
from sim_robot.scene import load_scene
from tests.support.plant_object import object_pose

CRATE = "[objects.crate]\nmass = 0.8\nsize = [0.16, 0.3, 0.22]\n"


def lab(folder: Path, text: str) -> Path:
    path = folder / "lab.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_new_object_has_what_was_measured_and_the_walls_of_a_filled_box(tmp_path: Path) -> None:
    file = lab(tmp_path, CRATE + "pad_friction = 0.5\n")
    scene = with_lab_objects(load_scene(), file)
    crate = scene.find("crate")
    assert (crate.mass, crate.size, crate.stiffness) == (0.8, (0.16, 0.3, 0.22), WALLS["stiffness"])
    assert scene.frictions("crate") == (0.5, load_scene().table.friction)
    assert difference(scene, file, "crate") is None
    assert load_scene().objects.items() <= scene.objects.items()  # those of the scene are what they were


def test_the_compiled_plant_has_mass_size_and_frictions(tmp_path: Path) -> None:
    file = lab(tmp_path, CRATE + "pad_friction = 0.5\ntable_friction = 0.3\n[objects.crate.plant]\nmass = 0.9\n")
    model = simulated_cell("crate", 0.0, seed=0, cell_file=file).plant.model
    geom = model.geom("object")
    assert model.body_mass[model.body("object").id] == pytest.approx(0.9)
    assert 2.0 * geom.size == pytest.approx((0.16, 0.3, 0.22))
    assert [model.geom(name).friction[0] for name in ("left_pad", "right_pad", "object", "table")] == [
        0.5,
        0.5,
        0.3,
        0.3,
    ]


def test_stiffer_walls_give_less(tmp_path: Path) -> None:
    soft, stiff = (
        simulated_cell("crate", 0.0, 0, cell_file=lab(tmp_path, f"{CRATE}[objects.crate.plant]\nstiffness = {wall}\n"))
        for wall in ("2e4", "2e5")
    )
    references = [cell.plant.model.geom("left_pad").solref for cell in (soft, stiff)]
    # of a pad of 6e4 N/m in series with each wall
    assert references[1][0] / references[0][0] == pytest.approx((1 / 2e4 + 1 / 6e4) / (1 / 2e5 + 1 / 6e4))


def test_what_differs_on_purpose_is_said(tmp_path: Path) -> None:
    file = lab(tmp_path, CRATE + "[objects.crate.plant]\nmass = 0.9\nsize = [0.16, 0.3, 0.2]\n")
    said = difference(with_lab_objects(load_scene(), file), file, "crate")
    assert said is not None
    assert "mass 0.9 kg (the controller: 0.8 kg)" in said
    assert "size 0.16 x 0.3 x 0.2 m (the controller: 0.16 x 0.3 x 0.22 m)" in said


def test_an_object_of_the_scene_stays_what_it_is_unless_the_plant_is_named(tmp_path: Path) -> None:
    measured = "[objects.rice_box]\nmass = 1.5\nsize = [0.2, 0.3, 0.2]\n"
    file = lab(tmp_path, measured)
    scene = with_lab_objects(load_scene(), file)
    assert scene.find("rice_box") == load_scene().find("rice_box")
    assert "mass 1.25 kg (the controller: 1.5 kg)" in (difference(scene, file, "rice_box") or "")
    file = lab(tmp_path, measured + "[objects.rice_box.plant]\nmass = 1.5\n")
    scene = with_lab_objects(load_scene(), file)
    assert (scene.find("rice_box").mass, difference(scene, file, "rice_box")) == (1.5, None)


def test_the_cells_friction_is_compared_too(tmp_path: Path) -> None:
    file = lab(tmp_path, "[contact_friction]\npad = 0.6\n" + CRATE)
    assert "pad_friction 0.9 (the controller: 0.6)" in (
        difference(with_lab_objects(load_scene(), file), file, "crate") or ""
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (CRATE + "[objects.crate.plant]\nmas = 1.0\n", "objects.crate.plant: key mas: Unexpected keyword"),
        (CRATE + "[objects.crate.plant]\nmass = -1.0\n", "crate.plant: key mass: Input should be greater than 0"),
        (CRATE + "[objects.crate.plant]\npad_friction = 0.0\n", "key pad_friction: Input should be greater than 0"),
        (CRATE + "plant = 3\n", "objects.crate.plant: expected a table"),
        ("[objects.crate]\nmass = 1.0\n", "key size: Field required"),
        ("objects = 3\n", "objects: expected a table"),
        ("[objects", "not valid TOML"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_key(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(said)) as refused:
        simulated_cell("crate", 0.0, seed=0, cell_file=lab(tmp_path, text))
    assert "lab.toml" in str(refused.value)


def test_an_object_stands_on_the_table(tmp_path: Path) -> None:
    cell = simulated_cell("crate", 0.0, seed=0, cell_file=lab(tmp_path, CRATE))
    before = object_pose(cell.plant)[0]
    for _ in range(300):
        cell.next_state()
    assert object_pose(cell.plant)[0] == pytest.approx(before, abs=1e-4)
    assert cell.plant.data.ncon == 4
    assert mujoco.mj_id2name(cell.plant.model, mujoco.mjtObj.mjOBJ_GEOM, cell.plant.data.contact.geom[0][0]) == "table"
