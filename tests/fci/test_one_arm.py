"""A server with one arm, through the real client."""

import contextlib
import socket
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np
import pylibfranka as franka
import pytest

from hal.desk import Trust
from hal.desk.power import start
from hal.displacement import Displacement
from hal.fci.arm import FciArm
from hal.state import RobotMode
from hal.wire import GRIPPER_PORT, PORT
from rtstack.cells.kinds import CellRequest, kind_of
from rtstack.cells.simulator import Simulator
from rtstack.model.cell_description import load_cell_description
from sim_robot.desk.process import PORT as DESK_PORT
from sim_robot.scene import load_scene
from tests.support.desk import desk_address, desk_of
from tests.support.fci.client import connect, hold, measured, move_to, torque_control
from tests.support.fci.server import serve
from tests.support.one_arm import one_arm_file


def refused(address: str, port: int) -> bool:
    """True where nobody listens."""
    try:
        socket.create_connection((address, port), timeout=10.0).close()
    except ConnectionRefusedError:
        return True
    return False


def moved_by_a_torque(address: str) -> np.ndarray:
    """Connect, read, push joint 2 for 300 ms; everything measured, (300, ...)."""
    robot = connect(address)
    q_hold = np.array(robot.read_once().q)
    push = 5.0 * np.eye(7)[1]
    states = torque_control(robot, 300, lambda tick, state: hold(state, q_hold) + push * np.sin(np.pi * tick / 300.0))
    assert all(state.control_command_success_rate == 1.0 for state in states)
    assert robot.read_once().robot_mode == franka.RobotMode.Idle
    return np.array([measured(state) for state in states])


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_torque_motion_of_the_one_arm_in_lockstep(side: str) -> None:
    runs = []
    for _ in range(2):
        with serve("--lockstep", "--only", side) as served:
            address, other = (served.left, served.right) if side == "left" else (served.right, served.left)
            assert refused(other, PORT)
            assert refused(other, GRIPPER_PORT)
            runs.append(moved_by_a_torque(address))
    assert np.array_equal(runs[0], runs[1])
    assert runs[0][0, :7] == pytest.approx(getattr(load_scene(), side).home, abs=2e-3)
    assert np.ptp(runs[0][:, 1]) > 5e-3


def test_a_reflex_and_the_recovery_of_the_one_arm() -> None:
    with serve("--lockstep", "--only", "right") as served:
        robot = connect(served.right)
        with pytest.raises(franka.ControlException, match="discontinuity"):
            torque_control(robot, 50, lambda tick, state: np.full(7, 50.0 * (tick > 20)))
        robot.automatic_error_recovery()
        move_to(robot, np.array(load_scene().right.home) + 0.05, 500)


def test_a_cells_file_with_one_arm_serves_this_arm() -> None:
    with (
        as_file(files("deploy.cells") / "one_arm.toml") as file,
        serve("--lockstep", "--cell-file", str(file)) as served,
    ):
        assert refused(served.right, PORT)
        moved_by_a_torque(served.left)


def test_a_user_stop_of_the_one_arm(tmp_path: Path) -> None:
    script = tmp_path / "stop.toml"
    script.write_text('[[fault]]\nkind = "user_stop"\narm = "right"\nat_s = 0.1\nduration_s = 0.2\n', encoding="utf-8")
    with serve("--lockstep", "--only", "right", f"--faults={script}") as served:
        robot = connect(served.right)
        with pytest.raises(franka.ControlException):
            torque_control(robot, 300, lambda tick, state: np.zeros(7))


def test_the_one_box_has_a_desk(tmp_path: Path) -> None:
    trust = Trust(tmp_path)
    with serve("--lockstep", "--desk", "--only", "right") as served:
        assert refused(served.left, DESK_PORT)
        with contextlib.closing(desk_of(served.right, trust)) as desk:
            list(start(desk, trust, desk_address(served.right)))
        FciArm(served.right).close()


def test_a_simulator_of_one_arm_says_where_it_is() -> None:
    simulator = Simulator("rice_box", 0.0, 0, lockstep=True, sides=("right",))
    try:
        assert simulator.left is None
        assert simulator.right is not None
        moved_by_a_torque(simulator.right)
    finally:
        simulator.close()


@pytest.mark.parametrize("kind", ["direct", "lockstep:honest"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_simulated_cell_has_the_one_arm_of_its_file(kind: str, side: str, tmp_path: Path) -> None:
    other = "right" if side == "left" else "left"
    file = one_arm_file(tmp_path, side)
    opened, argument = kind_of(kind)
    cell = opened.open(CellRequest(kind, argument, "", Displacement(), 1, load_cell_description(file), file))
    try:
        assert getattr(cell, other) is None
        cell.start()
        for _ in range(50):
            if cell.link is not None:
                cell.link.wait()
            state = getattr(cell, side).read()
            getattr(cell, side).write(np.zeros(7))
        assert state.robot_mode == RobotMode.MOVE
    finally:
        cell.close()


@pytest.mark.alone  # a link that lost 20 packets would raise
def test_one_arm_in_real_time_tells_its_pace_alone() -> None:
    with serve("--only", "left", "--priority=0") as served:
        robot = connect(served.left)
        q_hold = np.array(robot.read_once().q)
        torque_control(robot, 200, lambda tick, state: hold(state, q_hold))
    assert [line.partition(":")[0] for line in served.said if line.startswith(("left", "right"))] == ["left"]
