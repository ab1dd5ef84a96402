"""What the robot reports: noise without contact, known forces, what is rounded, and what is not known."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from hal.state import RobotMode
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.scene import load_scene
from tests.support.nominal_cell import nominal_cell
from tests.support.plant_object import object_pose
from tests.support.rigid_arm import RigidArm


def wrenches(cell: SimulatedCell, milliseconds: int) -> np.ndarray:
    """Both arms' O_F_ext_hat_K over time, (n, 2, 6); nobody commands the arms."""
    values = []
    for _ in range(milliseconds):
        values.append([arm.read().O_F_ext_hat_K.copy() for arm in (cell.left, cell.right)])
    return np.array(values)


def test_without_contact_the_wrench_is_noise() -> None:
    measured = wrenches(simulated_cell("rice_box", 0.0, seed=1), 2000)
    standard_error = measured.std(axis=0) / np.sqrt(len(measured))
    assert np.all(np.abs(measured.mean(axis=0)) < 4.0 * standard_error)
    assert 0.02 < measured[:, :, :3].std() < 0.4
    assert np.linalg.norm(measured[:, :, :3], axis=2).max() < 1.0


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("newton", [20.0, -20.0])
def test_a_known_force_on_the_pad_appears_within_five_percent(side: int, axis: int, newton: float) -> None:
    """Positive where the robot pushes the environment: the opposite of what pushes the pad."""
    cell = simulated_cell("rice_box", 0.0, seed=2)
    force = newton * np.eye(3)[axis]
    cell.plant.push(side, force)
    mean = wrenches(cell, 400)[200:].mean(axis=0)
    assert np.linalg.norm(mean[side, :3] + force) < 0.05 * 20.0
    assert np.linalg.norm(mean[side, 3:]) < 0.05 * 20.0 * 0.1
    assert np.linalg.norm(mean[1 - side, :3]) < 0.2


def test_the_wrench_is_along_the_axes_of_a_turned_base(tmp_path: Path) -> None:
    text = (files("sim_robot") / "scenes" / "grab.toml").read_text(encoding="utf-8")
    half = np.deg2rad(10.0) / 2.0
    turned = tmp_path / "turned.toml"
    old, new = "wxyz = [1.0, 0.0, 0.0, 0.0]", f"wxyz = [{np.cos(half)}, 0.0, 0.0, {np.sin(half)}]"
    turned.write_text(text.replace(old, new, 1), encoding="utf-8")
    cell = simulated_cell("rice_box", 0.0, seed=2, scene=turned)
    force = np.array([20.0, 5.0, 0.0])
    cell.plant.push(0, force)
    mean = wrenches(cell, 400)[200:, 0, :3].mean(axis=0)
    c, s = np.cos(2.0 * half), np.sin(2.0 * half)
    in_base = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ force
    assert np.linalg.norm(mean + in_base) < 0.05 * np.linalg.norm(force)


def test_the_force_rises_with_the_time_constant_of_30_hz() -> None:
    cell = nominal_cell("rice_box")
    wrenches(cell, 10)
    cell.plant.push(0, np.array([0.0, 20.0, 0.0]))
    rise = -wrenches(cell, 50)[:, 0, 1] / 20.0
    assert rise[4] == pytest.approx(1.0 - np.exp(-2.0 * np.pi * 30.0 * 5e-3), abs=0.02)


def test_near_a_singularity_the_wrench_is_unknown() -> None:
    cell = nominal_cell("rice_box")
    motors, data = cell.plant.motors, cell.plant.data
    stretched = np.array([0.0, 0.0, 0.0, -0.16, 0.0, 0.6, 0.0])
    motors[0]["theta"] += stretched - data.qpos[:7]
    motors[0]["theta_hold"] = motors[0]["theta"]
    data.qpos[:7] = stretched
    singular = np.linalg.svd(RigidArm(load_scene().pad).jacobian(stretched), compute_uv=False)
    assert singular.min() < 0.08
    cell.plant.push(0, np.array([0.0, 0.0, 5.0]))
    assert not wrenches(cell, 5)[-1, 0].any()
    assert np.abs(cell.states["tau_ext_hat_filtered"][0]).max() > 0.1


def test_the_pose_and_the_wrench_use_the_nominal_kinematics() -> None:
    cell = simulated_cell("rice_box", 0.0, seed=3)
    arm = RigidArm(load_scene().pad)
    cell.plant.push(0, np.array([5.0, 10.0, -5.0]))
    for _ in range(100):
        state = cell.left.read()
    pose, wrench = state.O_T_EE, state.O_F_ext_hat_K
    assert pose == pytest.approx(arm.pose(state.q).homogeneous, abs=1e-6)
    J = arm.jacobian(state.q)
    tau = state.tau_ext_hat_filtered
    damped = np.linalg.solve(J @ J.T + 0.005**2 * np.eye(6), J @ tau)
    assert wrench == pytest.approx(damped, abs=1e-3)


def test_every_float_is_a_float32() -> None:
    record = simulated_cell("rice_box", 0.0, seed=3).left.read().record[0]
    for name in record.dtype.names:
        value = np.asarray(record[name])
        if value.dtype == np.float64:
            assert np.array_equal(value, value.astype(np.float32).astype(np.float64)), name


def test_noise_is_about_as_large_as_the_file_says() -> None:
    cell = simulated_cell("rice_box", 0.0, seed=6)
    states = np.array([cell.left.read().record[0].copy() for _ in range(1500)])[500:]
    assert states["tau_J"].std(axis=0)[:4] == pytest.approx(np.full(4, 0.03), rel=0.15)
    assert states["dq"].std(axis=0) == pytest.approx(np.full(7, 5e-4), rel=0.15)
    assert states["q"].std(axis=0).max() < 5e-6
    assert len(np.unique(states["q"][:, 0])) > 1  # quantised, and not stuck


def test_the_state_says_what_the_arm_does() -> None:
    cell = simulated_cell("rice_box", 0.0, seed=6)
    state = cell.left.read()
    assert (state.t_ns, state.robot_mode) == (0, RobotMode.IDLE)
    assert state.record["control_command_success_rate"][0] == 0.0
    cell.left.write(np.full(7, 0.5))
    state = cell.left.read()
    assert (state.t_ns, state.robot_mode, state.current_errors) == (1_000_000, RobotMode.MOVE, 0)
    assert state.record["control_command_success_rate"][0] == 1.0
    assert np.array_equal(state.record["tau_J_d"][0], np.full(7, 0.5))
    assert cell.right.read().robot_mode == RobotMode.IDLE


def test_the_torque_rate_is_a_filtered_derivative() -> None:
    cell = nominal_cell("rice_box")
    cell.left.read()
    tau = np.zeros(7)
    for _ in range(60):
        tau[0] += 0.05  # 50 Nm/s, slow against the joints' oscillation
        cell.left.write(tau)
        state = cell.left.read()
    assert state.record["dtau_J"][0, 0] > 0.0
    before = state.tau_J[0]
    rates = []
    for _ in range(40):
        tau[0] += 0.05
        cell.left.write(tau)
        rates.append(cell.left.read().record["dtau_J"][0, 0])
    assert np.mean(rates) * 0.04 == pytest.approx(state.tau_J[0] - before, rel=0.2)


def test_the_tracker_sees_the_object_at_250_hz() -> None:
    cell = simulated_cell("rice_box", 0.02, seed=6)
    times, positions = [], []
    for _ in range(400):
        cell.left.read()
        pose = cell.tracker.latest()
        times.append(pose.t_ns)
        positions.append(pose.position.copy())
        assert np.linalg.norm(pose.orientation_wxyz) == pytest.approx(1.0)
    assert np.array_equal(np.unique(times), np.arange(0, 400, 4) * 1_000_000)
    frames = np.array(positions)[::4]
    assert frames.mean(axis=0) == pytest.approx(object_pose(cell.plant)[0], abs=2e-4)
    assert frames[20:].std(axis=0) == pytest.approx(np.full(3, 1e-4), rel=0.3)
