"""What the robot refuses: each reflex latches, says its name, leaves the rest running, and recovers."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hal.errors import CommandRejected, ConnectionLost, RecoveryRefused
from hal.state import RobotMode
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.plant_parameters import load_plant_parameters
from sim_robot.scene import load_scene
from tests.support.rigid_arm import RigidArm

NO_TORQUE = np.zeros(7)


def moving_cell() -> SimulatedCell:
    cell = simulated_cell("rice_box", 0.0, seed=9)
    for arm in (cell.left, cell.right):
        arm.read()
        arm.write(NO_TORQUE)
    return cell


def run_until_rejected(cell: SimulatedCell, left_torque: Callable[[int], np.ndarray | None]) -> tuple[str, ...]:
    """Tick both arms until the left one is rejected, and return the errors. The right one must go on."""
    for tick in range(2000):
        try:
            cell.left.read()
            tau = left_torque(tick)
            if tau is not None:
                cell.left.write(tau)
        except CommandRejected as rejected:
            return rejected.errors
        cell.right.read()
        cell.right.write(NO_TORQUE)
    raise AssertionError("the left arm was never rejected")


def assert_latched(cell: SimulatedCell, name: str) -> None:
    """The left arm refuses reads and writes, brakes and holds; time and the right arm go on."""
    before = cell.plant.ticks
    for _ in range(300):
        with pytest.raises(CommandRejected, match=name):
            cell.left.read()
        with pytest.raises(CommandRejected, match=name):
            cell.left.write(NO_TORQUE)
        assert cell.right.read().robot_mode == RobotMode.MOVE
        cell.right.write(NO_TORQUE)
    assert cell.plant.ticks == before + 300
    assert RobotMode(int(cell.states["robot_mode"][0])) == RobotMode.REFLEX
    cell.left.stop()  # ending torque control does not clear a reflex
    with pytest.raises(CommandRejected):
        cell.left.read()


def assert_recovers(cell: SimulatedCell) -> None:
    cell.left.recover()
    cell.left.read()
    assert np.abs(cell.plant.data.qvel[:7]).max() < 1e-2
    cell.left.write(NO_TORQUE)
    state = cell.left.read()
    assert state.robot_mode == RobotMode.MOVE
    assert state.current_errors == 0


@pytest.mark.parametrize(
    "tau",
    [np.full(7, np.nan), np.full(7, np.inf), np.array([0, 0, 0, 0, 0, 0, 1.001]), np.array([-1.1, 0, 0, 0, 0, 0, 0])],
)
def test_a_command_that_is_not_finite_or_jumps_is_a_discontinuity(tau: np.ndarray) -> None:
    cell = moving_cell()
    errors = run_until_rejected(cell, lambda tick: tau if tick == 5 else NO_TORQUE)
    assert errors == ("controller_torque_discontinuity",)
    assert_latched(cell, "controller_torque_discontinuity")
    assert_recovers(cell)


def test_a_torque_at_the_rate_limit_is_accepted() -> None:
    cell = moving_cell()
    tau = np.zeros(7)
    for tick in range(20):
        cell.left.read()
        tau = tau + (1.0 if tick % 4 < 2 else -1.0) * np.ones(7)
        cell.left.write(tau)
    assert cell.left.read().robot_mode == RobotMode.MOVE


def test_twenty_milliseconds_without_a_command_break_the_communication() -> None:
    cell = moving_cell()
    cell.left.read()
    cell.left.write(NO_TORQUE)
    start = cell.plant.ticks + 1  # the millisecond of that command
    errors = run_until_rejected(cell, lambda tick: None)
    assert errors == ("communication_constraints_violation",)
    assert cell.plant.ticks - start == 20
    assert_latched(cell, "communication_constraints_violation")
    assert_recovers(cell)


def test_a_joint_that_is_too_fast_is_stopped() -> None:
    cell = moving_cell()
    errors = run_until_rejected(cell, lambda tick: np.array([min(tick, 30.0), 0, 0, 0, 0, 0, 0]))
    assert errors == ("joint_velocity_violation",)
    with pytest.raises(RecoveryRefused, match="joint_velocity_violation"):
        cell.left.recover()
    assert_latched(cell, "joint_velocity_violation")
    assert_recovers(cell)


def test_a_joint_beyond_its_range_is_stopped_and_stays_refused_until_it_is_back() -> None:
    cell = moving_cell()
    cell.left.read()

    def turn_last_joint(angle: float) -> None:
        motor, beyond = cell.plant.motors[0], angle - cell.plant.data.qpos[6]
        cell.plant.data.qpos[6] += beyond
        motor["theta"][6] += beyond
        motor["theta_hold"][6] += beyond

    turn_last_joint(3.03)
    errors = run_until_rejected(cell, lambda tick: NO_TORQUE)
    assert "joint_position_limits_violation" in errors
    assert_latched(cell, "joint_position_limits_violation")
    with pytest.raises(RecoveryRefused, match=r"joint_position_limits_violation.*move the left arm back"):
        cell.left.recover()
    turn_last_joint(1.0)
    for _ in range(300):  # the jump rings
        with pytest.raises(CommandRejected):
            cell.left.read()
    assert_recovers(cell)


def test_a_joint_torque_beyond_its_range_is_stopped_and_stays_refused_while_it_is_pushed() -> None:
    cell = moving_cell()
    J = RigidArm(load_scene().pad).jacobian(np.array(load_scene().left.home))

    def resist(tick: int) -> np.ndarray:
        cell.plant.push(0, np.array([0.0, float(tick), 0.0]))
        return -J[1] * tick

    errors = run_until_rejected(cell, resist)
    assert errors == ("tau_j_range_violation",)
    assert_latched(cell, "tau_j_range_violation")
    with pytest.raises(RecoveryRefused, match="tau_j_range_violation"):
        cell.left.recover()
    cell.plant.push(0, np.zeros(3))
    for _ in range(300):
        with pytest.raises(CommandRejected):
            cell.left.read()
    assert_recovers(cell)


def strict_cell(**reflexes: object) -> SimulatedCell:
    """A moving cell with other tolerances."""
    parameters = load_plant_parameters()
    parameters = replace(parameters, reflexes=replace(parameters.reflexes, **reflexes))
    cell = simulated_cell("none", 0.0, seed=9, parameters=parameters)
    for arm in (cell.left, cell.right):
        arm.read()
        arm.write(NO_TORQUE)
    return cell


def turn(tick: int) -> np.ndarray:
    return np.array([min(tick, 30.0), 0, 0, 0, 0, 0, 0])


def test_an_arm_beyond_its_power_is_stopped() -> None:
    name = "power_limit_violation"
    cell = strict_cell(largest_power=5.0)
    assert run_until_rejected(cell, turn) == (name,)
    assert_latched(cell, name)
    assert_recovers(cell)


def test_an_end_effector_beyond_a_virtual_wall_is_stopped_and_stays_refused() -> None:
    y = float(strict_cell().states["O_T_EE"][0, 1, 3])
    cell = strict_cell(walls_lower=(-10.0, y - 1e-3, -10.0))
    assert run_until_rejected(cell, lambda tick: -turn(tick)) == ("cartesian_position_limits_violation",)
    assert_latched(cell, "cartesian_position_limits_violation")
    with pytest.raises(RecoveryRefused, match="cartesian_position_limits_violation"):
        cell.left.recover()


def test_a_joint_that_swings_is_an_instability() -> None:
    cell = strict_cell()
    law = lambda tick: np.array([0, 0, 0, 0, 0, 4.0 * np.sin(2.0 * np.pi * 38.0e-3 * tick), 0])  # noqa: E731
    assert run_until_rejected(cell, law) == ("instability_detected",)
    assert_latched(cell, "instability_detected")
    assert_recovers(cell)


def test_a_joint_that_is_pushed_further_beyond_its_limit_moves_in_the_wrong_direction() -> None:
    cell = strict_cell()
    cell.left.read()
    cell.plant.data.qpos[6] += 3.03 - cell.plant.data.qpos[6]
    for name in ("theta", "theta_hold"):
        cell.plant.motors[0][name][6] += 3.03 - cell.plant.motors[0][name][6]
    errors = run_until_rejected(cell, lambda tick: NO_TORQUE)
    assert "joint_position_limits_violation" in errors
    assert "joint_move_in_wrong_direction" not in errors
    cell.plant.motors[0]["theta_hold"][6] += 0.02  # as a hand that pushes it outwards
    for _ in range(200):
        with pytest.raises(CommandRejected):
            cell.left.read()
    with pytest.raises(CommandRejected, match="joint_move_in_wrong_direction"):
        cell.left.read()


def test_a_bad_first_command_is_a_reflex_of_an_arm_that_never_moved() -> None:
    cell = simulated_cell("rice_box", 0.0, seed=9)
    start = cell.left.read().q.copy()
    cell.left.write(np.full(7, 5.0))
    with pytest.raises(CommandRejected, match="left arm in reflex: controller_torque_discontinuity"):
        cell.left.read()
    assert np.abs(cell.plant.data.qpos[:7] - start).max() < 1e-4
    cell.left.recover()
    assert cell.left.read().robot_mode == RobotMode.IDLE


def test_stop_holds_and_a_new_command_starts_again() -> None:
    cell = moving_cell()
    for tick in range(100):
        cell.left.read()
        cell.left.write(np.array([min(tick, 5.0), 0, 0, 0, 0, 0, 0]))
    cell.left.stop()
    cell.left.stop()
    for _ in range(500):
        state = cell.left.read()
    assert state.robot_mode == RobotMode.IDLE
    assert np.abs(cell.plant.data.qvel[:7]).max() < 1e-3
    cell.left.write(NO_TORQUE)
    assert cell.left.read().robot_mode == RobotMode.MOVE


def test_a_closed_arm_says_so() -> None:
    cell = moving_cell().as_cell("direct")
    assert cell.name == "direct"
    cell.close()
    cell.close()
    for arm in (cell.left, cell.right):
        with pytest.raises(ConnectionLost, match="was closed"):
            arm.read()
        with pytest.raises(ConnectionLost, match="was closed"):
            arm.write(NO_TORQUE)
