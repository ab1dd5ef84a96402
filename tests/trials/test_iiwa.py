"""An arm that is no Franka, examples/iiwa: it is what KUKA publishes, and it grabs within its own limits."""

from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pinocchio as pin

from hal.robots import FR3, robot
from rtstack.log.reader import read_log
from rtstack.model.cell_description import load_cell_description
from sim_robot.cell import cell_scene

FOLDER = Path(__file__).parents[2] / "examples" / "iiwa" / "iiwa"
CELL, MODEL = FOLDER / "two_iiwas.toml", robot(str(FOLDER / "iiwa14.toml"))


def test_its_flange_is_where_the_data_sheet_s_lengths_put_it() -> None:
    """360, 420, 400 and 126 mm; the axes are upright, and every second one lies across."""
    q = np.array([0.3, -0.4, 0.5, -1.2, 0.7, 0.8, -0.6])
    expected = pin.SE3.Identity()
    for length, quarter, angle in zip(
        (0.36, 0.0, 0.42, 0.0, 0.4, 0.0, 0.126), (0, -1, 1, 1, -1, -1, 1), q, strict=True
    ):
        turned = pin.rpy.rpyToMatrix(quarter * np.pi / 2, 0.0, 0.0) @ pin.rpy.rpyToMatrix(0.0, 0.0, angle)
        expected = expected * pin.SE3(turned, np.zeros(3)) * pin.SE3(np.eye(3), np.array([0.0, 0.0, length]))
    model = pin.buildModelFromXML(MODEL.urdf)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    np.testing.assert_allclose(data.oMf[model.getFrameId("link8")].homogeneous, expected.homogeneous, atol=1e-12)
    np.testing.assert_allclose(np.degrees(MODEL.limits.dq_max), [85, 85, 100, 75, 130, 135, 135], atol=0.01)
    np.testing.assert_allclose(np.degrees(MODEL.limits.q_upper), [170, 120, 170, 120, 170, 120, 175], atol=0.01)


def test_nothing_of_its_joints_is_a_franka_s() -> None:
    assert {"B", "B_theta", "K", "D", "friction_p1", "friction_p2", "friction_p3"} == set(MODEL.plant)
    assert not np.any(np.asarray(MODEL.limits.tau_max) == FR3.limits.tau_max)


def test_the_simulated_arms_and_table_are_where_the_file_says() -> None:
    scene, cell = cell_scene(None, CELL), load_cell_description(CELL)
    for placed, mounting in zip(scene.arms, cell.arms, strict=True):
        assert placed.T_world_base_position == mounting.base_position
        assert (placed.home, placed.robot) == (mounting.home, MODEL)
    assert scene.table.top_z == cell.table.top_z


def test_it_grabs_in_simulation(tmp_path: Path, command_line: Callable[..., CompletedProcess[str]]) -> None:
    reference, path = tmp_path / "ref.mcap", tmp_path / "trial.mcap"
    taught = command_line("teach", reference, "--cell-file", CELL)
    assert taught.returncode == 0, taught.stderr
    ran = command_line("trial", "--reference", reference, "--cell-file", CELL, "--displacement-mm=-20", "--log", path)
    assert ran.returncode == 0, ran.stderr + ran.stdout
    log = read_log(path)
    for side in ("left", "right"):
        arm = log.topic(f"/{side}/arm")
        assert np.all(np.abs(arm["dq"]) <= MODEL.limits.dq_max)
        assert np.all(np.abs(arm["tau_J"]) <= MODEL.limits.tau_max)
        assert np.abs(arm["tau_J"][0, 1]) > 50.0  # it carries itself, 25 kg: an FR3's joint 2 holds 23 Nm there
