"""Every request is answered, and the state shows what was set. The layout is what this pylibfranka expects."""

import numpy as np
import pylibfranka as franka
import pytest

from hal.robots import FR3
from sim_robot.fci.protocol import Command, SetStatus
from tests.support.fci.client import connect, hold, torque_control
from tests.support.fci.raw import RawClient
from tests.support.fci.server import Served


def transform(angle: float, offset: tuple[float, float, float]) -> np.ndarray:
    T = np.eye(4)
    T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    T[:3, 3] = offset
    return T


def matrix(values: list[float]) -> np.ndarray:
    return np.array(values).reshape(4, 4).T


def test_the_layout_is_that_of_this_pylibfranka(lockstep: Served) -> None:
    """Each value where the client looks for it: what a new release moves, this shows first."""
    robot = connect(lockstep.left)
    with_load = (0.5, [0.01, 0.02, 0.03], list(np.diag([1e-3, 2e-3, 3e-3]).ravel()))
    robot.set_load(*with_load)
    state = robot.read_once()
    assert state.m_load == 0.5
    assert state.F_x_Cload == pytest.approx(with_load[1])
    assert state.I_load == pytest.approx(with_load[2])
    assert state.m_ee == pytest.approx(0.35)
    assert state.m_total == pytest.approx(0.85)
    assert np.all((np.array(state.q) > FR3.limits.q_lower) & (np.array(state.q) < FR3.limits.q_upper))
    assert np.array(state.theta) == pytest.approx(state.q, abs=5e-3)
    assert state.O_ddP_O == pytest.approx([0.0, 0.0, -9.81])
    assert state.elbow == [state.q[2], -1.0]
    assert matrix(state.O_T_EE)[3].tolist() == [0.0, 0.0, 0.0, 1.0]
    assert matrix(state.F_T_EE)[:3, 3] == pytest.approx([0.0, 0.0, 0.03])
    assert not state.current_errors
    robot.set_load(0.0, [0.0] * 3, [0.0] * 9)


def test_frames_that_are_set_move_the_end_effector_and_the_wrench(lockstep: Served) -> None:
    robot = connect(lockstep.left)
    before = robot.read_once()
    NE_T_EE, EE_T_K = transform(0.3, (0.01, 0.02, 0.05)), transform(-0.2, (0.0, 0.03, 0.0))
    robot.set_EE(list(NE_T_EE.T.ravel()))
    robot.set_K(list(EE_T_K.T.ravel()))
    state = robot.read_once()
    assert matrix(state.NE_T_EE) == pytest.approx(NE_T_EE, abs=1e-6)
    assert matrix(state.EE_T_K) == pytest.approx(EE_T_K, abs=1e-6)
    assert matrix(state.F_T_EE) == pytest.approx(matrix(state.F_T_NE) @ NE_T_EE, abs=1e-6)
    assert matrix(state.O_T_EE) == pytest.approx(matrix(before.O_T_EE) @ NE_T_EE, abs=1e-4)
    rotation = (matrix(state.O_T_EE) @ EE_T_K)[:3, :3]
    assert state.K_F_ext_hat_K[:3] == pytest.approx(rotation.T @ state.O_F_ext_hat_K[:3], abs=1e-4)
    robot.set_EE(list(np.eye(4).ravel()))
    robot.set_K(list(np.eye(4).ravel()))


def test_a_load_that_is_not_there_pushes_the_arm(lockstep: Served) -> None:
    """The robot lifts a mass that it was told of; without it, it pushes down on nothing: minus its weight."""
    robot = connect(lockstep.left)
    robot.set_load(0.5, [0.0, 0.0, 0.03], [0.0] * 9)
    q_hold = np.array(robot.read_once().q)
    state = torque_control(robot, 500, lambda tick, state: hold(state, q_hold))[-1]
    assert abs(state.O_F_ext_hat_K[2]) == pytest.approx(0.5 * 9.81, rel=0.2)
    robot.set_load(0.0, [0.0] * 3, [0.0] * 9)


def test_the_other_settings_are_taken_and_bad_ones_refused(lockstep: Served) -> None:
    robot = connect(lockstep.left)
    robot.set_joint_impedance([2000.0] * 7)
    robot.set_cartesian_impedance([1500.0] * 3 + [150.0] * 3)
    robot.set_collision_behavior([20.0] * 7, [100.0] * 7, [20.0] * 6, [250.0] * 6)
    with pytest.raises(franka.CommandException, match="invalid argument"):
        robot.set_joint_impedance([-1.0] * 7)
    with pytest.raises(franka.CommandException, match="invalid argument"):
        robot.set_EE([2.0, *([0.0] * 14), 1.0])
    with pytest.raises(franka.CommandException, match="invalid argument"):
        robot.set_load(float("nan"), [0.0] * 3, [0.0] * 9)
    robot.set_joint_impedance([3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0])
    robot.set_cartesian_impedance([3000.0] * 3 + [300.0] * 3)


def test_settings_are_refused_while_the_arm_moves(lockstep: Served) -> None:
    with RawClient(lockstep.right) as raw:
        raw.connect()
        raw.move()
        raw.command(raw.state())
        raw.send(Command.SET_JOINT_IMPEDANCE, np.full(7, 100.0).tobytes())
        assert raw.answer() == (Command.SET_JOINT_IMPEDANCE, 3, bytes((SetStatus.NOT_POSSIBLE,)))
        assert raw.move() == 5  # NotPossible: it moves already
        raw.send(Command.STOP_MOVE)
        assert raw.answer()[2] == b"\x02"  # the motion was preempted
        assert raw.answer()[2] == b"\x00"


def test_guiding_is_accepted_at_rest_and_refused_while_the_arm_moves(lockstep: Served) -> None:
    """Nobody takes a simulated arm by the hand: it goes on to hold its place."""
    with RawClient(lockstep.left) as raw:
        raw.connect()
        raw.send(Command.SET_GUIDING_MODE, bytes((1,) * 7))
        assert raw.answer()[2] == bytes((SetStatus.SUCCESS,))
        assert raw.state()["robot_mode"] == franka.RobotMode.Idle.value
        raw.move()
        raw.send(Command.SET_GUIDING_MODE, bytes(7))
        assert raw.answer()[2] == bytes((SetStatus.NOT_POSSIBLE,))


def test_the_model_is_that_of_the_arm(lockstep: Served) -> None:
    robot = connect(lockstep.left)
    model, state = robot.load_model(), robot.read_once()
    assert np.array(model.gravity(state)) == pytest.approx(state.tau_J, abs=1.5)
    assert np.array(model.zero_jacobian(state)).size == 42
    mass = np.array(model.mass(state)).reshape(7, 7)
    assert np.linalg.eigvalsh(mass).min() > 0.0
