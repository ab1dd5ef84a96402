"""The scene: what is written in it, what it refuses, and where objects may stand."""

import re
from importlib.resources import files
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from hal.configuration import ConfigurationError
from hal.displacement import Displacement
from hal.errors import ObjectOutOfReach, UnknownObject
from sim_robot.cell import simulated_cell
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import load_scene
from tests.support.rigid_arm import RigidArm

GRAB = (files("sim_robot") / "scenes" / "grab.toml").read_text(encoding="utf-8")
PLANT = (files("sim_robot") / "parameters" / "plant.toml").read_text(encoding="utf-8")


def changed(tmp_path: Path, text: str, old: str, new: str) -> Path:
    assert old in text
    path = tmp_path / "changed.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("top_z = 0.2", "top_z = 0.2\ncolour = 3", "key table.colour: Unexpected keyword"),
        ("top_z = 0.2", "", "key table.top_z: Field required"),
        ("top_z = 0.2", 'top_z = "high"', "key table.top_z: Input should be a valid number"),
        ("top_z = 0.2", "top_z = true", "top_z: Input should be a valid number"),
        ("top_z = 0.2", "top_z = nan", "top_z: Input should be a finite number"),
        ("top_z = 0.2", "top_z = -0.2", "top_z must be positive"),
        ("size = [0.1, 0.1, 0.03]", "size = [0.1, 0.1]", "size.2: Field required"),
        ("mass = 1.25", "mass = 0", "key objects.rice_box: mass must be positive"),
        ("impedance = 0.1", "impedance = 1.0", "impedance must be within"),
        ("wxyz = [1.0", "wxyz = [1.1", "unit quaternion"),
        ('name = "grab"', "name = ", "not valid TOML"),
    ],
)
def test_a_bad_scene_names_what_is_wrong(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(message)):
        load_scene(changed(tmp_path, GRAB, old, new))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("q_noise = 2e-6", "q_noise = -1", "q_noise must not be negative"),
        ("rate_hz = 250.0", "rate_hz = 300.0", "rate_hz must divide 1000"),
        (
            "communication_timeout_ms = 20",
            "communication_timeout_ms = 20.5",
            "timeout_ms: Input should be a valid integer",
        ),
        ("K = [14250.0, ", "K = [", "K.6: Field required"),
    ],
)
def test_bad_plant_parameters_name_what_is_wrong(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(message)):
        load_plant_parameters(changed(tmp_path, PLANT, old, new))


def test_home_puts_the_pads_face_to_face_in_front_of_the_object() -> None:
    scene = load_scene()
    arm = RigidArm(scene.pad)
    for place, side in ((scene.left, 1.0), (scene.right, -1.0)):
        T = arm.pose(np.array(place.home))
        assert T.translation + place.T_world_base_position == pytest.approx([0.0, 0.35 * side, 0.26], abs=1e-5)
        assert T.rotation == pytest.approx(np.array([[1, 0, 0], [0, 0, -side], [0, side, 0]]), abs=1e-5)
    mirrored = np.array(scene.left.home) * (-1, 1, -1, 1, -1, 1, -1)
    assert np.array_equal(mirrored, scene.right.home)


@pytest.mark.parametrize("name", sorted(load_scene().objects))
def test_every_object_stands_still_on_the_table_and_touches_nothing_else(name: str) -> None:
    cell = simulated_cell(name, 0.03, seed=5)
    start, _ = cell.object_truth()
    for _ in range(200):
        cell.left.read()
    position, wxyz = cell.object_truth()
    assert np.abs(position - start)[:2].max() < 1e-4
    assert 0.0 <= start[2] - position[2] < 1e-3  # what it sinks into its own stiffness
    assert abs(wxyz[1]) + abs(wxyz[2]) < 1e-4
    touching = {frozenset((cell.plant.model.geom(c.geom1).name, cell.plant.model.geom(c.geom2).name))
                for c in cell.plant.data.contact}  # fmt: skip
    assert touching == {frozenset(("table", "object"))}


def test_an_unknown_object_is_answered_with_the_known_names() -> None:
    with pytest.raises(UnknownObject, match=r"'brick'.*bottles.*rice_box.*\[objects.brick\].*--cell-file"):
        simulated_cell("brick", 0.0, seed=0)


@pytest.mark.parametrize("displacement_m", [0.2, -0.2, 1.0, float("nan")])
def test_an_object_in_a_pads_place_is_out_of_reach(displacement_m: float) -> None:
    with pytest.raises(ObjectOutOfReach, match=re.escape("allowed are -190 to +190 mm")):
        simulated_cell("rice_box", displacement_m, seed=0)


def test_an_object_off_the_table_is_out_of_reach(tmp_path: Path) -> None:
    narrow = changed(tmp_path, GRAB, "size_xy = [0.56, 0.8]", "size_xy = [0.56, 0.4]")
    assert simulated_cell("rice_box", 0.049, seed=0, scene=narrow).object_truth()[0][1] == pytest.approx(
        0.049, abs=5e-3
    )
    with pytest.raises(ObjectOutOfReach, match=re.escape("allowed are -50 to +50 mm")):
        simulated_cell("rice_box", 0.051, seed=0, scene=narrow)


@pytest.mark.parametrize(
    ("displacement", "said"),
    [
        (Displacement(x_m=0.11), "+110 mm from its place along x: allowed are -100 to +100 mm"),
        (Displacement(x_m=float("nan")), "along x"),
        (Displacement(y_m=0.19, yaw_rad=0.1), "along y: allowed are -181 to +181 mm"),
        (Displacement(yaw_rad=0.8), "+46 deg: allowed are -45 to +45 deg"),
        (Displacement(yaw_rad=float("nan")), "allowed are -45 to +45 deg"),
    ],
)
def test_an_object_that_is_shifted_or_turned_too_far_is_out_of_reach(displacement: Displacement, said: str) -> None:
    with pytest.raises(ObjectOutOfReach, match=re.escape(said)):
        simulated_cell("rice_box", displacement, seed=0)


def test_an_object_stands_where_it_is_shifted_and_turned_to() -> None:
    plain, moved = (
        simulated_cell("rice_box", place, seed=5).object_truth()
        for place in (Displacement(y_m=-0.02), Displacement(0.01, -0.02, np.radians(5.0)))
    )
    assert moved[0] - plain[0] == pytest.approx((0.01, 0.0, 0.0), abs=1e-12)
    turn = [2.0 * np.arctan2(wxyz[3], wxyz[0]) for _, wxyz in (plain, moved)]
    assert np.degrees(turn[1] - turn[0]) == pytest.approx(5.0)
    assert moved[1][1:3] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("tilt_deg", [0.0, 8.0])
def test_a_number_is_a_shift_along_y_to_the_bit(tilt_deg: float) -> None:
    scene, faces = load_scene(), (0.35, -0.35)
    one, other = (
        scene.place("rice_box", place, faces, np.random.default_rng(1), tilt_deg)
        for place in (-0.03, Displacement(y_m=-0.03))
    )
    assert one == other


def test_a_turned_and_tilted_object_stays_above_the_table() -> None:
    scene = load_scene()
    place = scene.place("rice_box", Displacement(yaw_rad=0.5), (0.35, -0.35), None, tilt_deg=8.0)
    rotation = pin.Quaternion(*place.wxyz).toRotationMatrix()
    corners = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]) * np.array([0.1, 0.15, 0.1])
    assert (corners @ rotation.T)[:, 2].min() + place.position[2] == pytest.approx(scene.table.top_z, abs=1e-9)


def test_placement_scatters_by_about_a_millimetre_with_the_seed() -> None:
    starts = np.array([simulated_cell("rice_box", 0.03, seed).object_truth()[0] for seed in range(30)])
    offset = starts[:, :2] - (0.0, 0.03)
    assert 0.6e-3 < offset.std() < 1.5e-3
    assert np.abs(offset.mean(axis=0)).max() < 4 * 1e-3 / np.sqrt(30)
