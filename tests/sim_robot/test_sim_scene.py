"""The scene: what is written in it, what it refuses, and where objects may stand."""

import re
from importlib.resources import files
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from hal.base.configuration import ConfigurationError
from hal.displacement import Displacement
from hal.errors import ObjectOutOfReach, UnknownObject
from hal.tracker import ObjectPose, TrackerFrames
from hal.tracker_link import TrackerLink
from sim_robot.cell import simulated_cell
from sim_robot.fci.server import TrackerFeed
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.profile import Built
from sim_robot.scene import load_scene
from tests.support.built_cell import profile
from tests.support.plant_object import object_pose
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
        ("top_z = 0.2", "top_z = -0.2", "key table.top_z: Input should be greater than 0"),
        ("size = [0.1, 0.1, 0.03]", "size = [0.1, 0.1]", "size.2: Field required"),
        ("mass = 1.25", "mass = 0", "key objects.rice_box.mass: Input should be greater than 0"),
        ("impedance = 0.1", "impedance = 1.0", "contact.impedance: Input should be less than or equal to 0.9999"),
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
        ("q_noise = 2e-6", "q_noise = -1", "sensors.q_noise: Input should be greater than or equal to 0"),
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
    start, _ = object_pose(cell.plant)
    for _ in range(200):
        cell.left.read()
    position, wxyz = object_pose(cell.plant)
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
    position, _ = object_pose(simulated_cell("rice_box", 0.049, seed=0, scene=narrow).plant)
    assert position[1] == pytest.approx(0.049, abs=5e-3)
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
        object_pose(simulated_cell("rice_box", place, seed=5).plant)
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
    starts = np.array([object_pose(simulated_cell("rice_box", 0.03, seed).plant)[0] for seed in range(30)])
    offset = starts[:, :2] - (0.0, 0.03)
    assert 0.6e-3 < offset.std() < 1.5e-3
    assert np.abs(offset.mean(axis=0)).max() < 4 * 1e-3 / np.sqrt(30)


def test_a_cell_that_is_built_right_is_the_scene_itself():
    scene = load_scene()
    assert Built().scene(scene) is scene


def test_bases_stand_elsewhere_and_sides_are_exchanged(tmp_path: Path):
    built: dict[str, object] = {"left_mm": [20.0, -10.0, 5.0], "left_deg": [0.0, 0.0, 3.0]}
    straight = simulated_cell("none", 0.0, 1).plant.data
    moved = simulated_cell("none", 0.0, 1, profile=str(profile(tmp_path / "moved.toml", built))).plant.data
    away = moved.body("left_link0").xpos - straight.body("left_link0").xpos
    np.testing.assert_allclose(away, [0.02, -0.01, 0.005], atol=1e-12)
    turn = moved.body("left_link0").xmat.reshape(3, 3) @ straight.body("left_link0").xmat.reshape(3, 3).T
    np.testing.assert_allclose(Rotation.from_matrix(turn).as_rotvec(degrees=True), [0.0, 0.0, 3.0], atol=1e-9)
    np.testing.assert_array_equal(moved.body("right_link0").xpos, straight.body("right_link0").xpos)
    other = simulated_cell("none", 0.0, 1, profile=str(profile(tmp_path / "other.toml", {"swapped": True}))).plant.data
    np.testing.assert_array_equal(other.body("left_link0").xpos, straight.body("right_link0").xpos)


def test_a_tracker_in_another_frame_is_placed_by_the_cells_file_and_is_refused_in_this_process(tmp_path: Path):
    built = Built(tracker_mm=(300.0, -400.0, 50.0), tracker_deg=(10.0, -20.0, 90.0), pivot_mm=(60.0, -30.0, 90.0))
    truth = ObjectPose.empty()
    truth.record["t_ns"], truth.record["seen"] = 5, 1
    truth.position[:] = (0.01, 0.02, 0.3)
    truth.orientation_wxyz[:] = Rotation.from_euler("z", 0.4).as_quat(scalar_first=True)

    class Seeing:
        def latest(self) -> ObjectPose:
            return truth

    w, x, y, z = Rotation.from_rotvec(built.tracker_deg, degrees=True).as_quat(scalar_first=True).tolist()
    link = TrackerLink(frames=TrackerFrames("z", (0.3, -0.4, 0.05), (w, x, y, z), (-0.06, 0.03, -0.09)))
    feed = TrackerFeed(built.tracker(Seeing()), link.address)
    feed.publish(5, 5)
    pose = link.latest()
    np.testing.assert_allclose(pose.position, truth.position, atol=1e-12)
    np.testing.assert_allclose(np.abs(pose.orientation_wxyz @ truth.orientation_wxyz), 1.0, atol=1e-12)
    feed.close()
    link.close()
    file = profile(tmp_path / "tracker.toml", {"tracker_mm": [1.0, 0.0, 0.0]})
    with pytest.raises(ConfigurationError, match="lockstep, realtime"):
        simulated_cell("none", 0.0, 1, profile=str(file))
    assert Built(left_mm=(1.0, 0.0, 0.0)).tracker(seeing := Seeing()) is seeing
