"""A simulated cell that was built otherwise than its scene says."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hal.configuration import ConfigurationError
from hal.tracker import ObjectPose, TrackerFrames
from hal.tracker_link import TrackerLink
from sim_robot.built import Built
from sim_robot.cell import simulated_cell
from sim_robot.fci.tracker_feed import TrackerFeed
from sim_robot.scene import load_scene
from tests.programs.wrong_built_cell import profile


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
