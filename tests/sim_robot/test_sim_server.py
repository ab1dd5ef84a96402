"""A server in this process: what it compiles once it serves, and how long lockstep waits."""

import contextlib
import itertools
import os
import threading
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numba.core import event

import sim_robot
from hal.robot_errors import ROBOT_ERRORS, error_names
from hal.state import RobotMode
from hal.wire import ROBOT_COMMAND
from sim_robot.cell import simulated_cell
from sim_robot.fci.arm_server import ArmServer
from sim_robot.fci.drive import DrivenBox
from sim_robot.fci.lockstep import Lockstep
from sim_robot.fci.protocol import Command, Controller, Generator, MoveStatus
from sim_robot.fci.server import Server
from sim_robot.plant_parameters import load_plant_parameters
from tests.support.fci.raw import RawClient

_last_octet = itertools.count(1)
ANYWHERE = (10.0, 3.12, 6.28) * 2


@pytest.fixture
def addresses() -> tuple[str, str]:
    number = os.getpid()
    left, right = (f"127.{20 + number // 250 % 14}.{1 + number % 250}.{next(_last_octet)}" for _ in range(2))
    return left, right


@pytest.fixture
def server(addresses: tuple[str, str]) -> Iterator[Server]:
    cell = simulated_cell("rice_box", 0.0, 0, box_kind=DrivenBox)
    server = Server(cell, load_plant_parameters(), addresses)
    yield server
    server.close()


def move_values(controller: int, generator: int, asynchronous: int = 0) -> tuple:
    return (controller, generator, *ANYWHERE, asynchronous, *(0.0,) * 7)


class Compilations(event.Listener):
    """Counts what numba compiles."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def on_start(self, event: event.Event) -> None:
        self.names.append(str(event.data))

    def on_end(self, event: event.Event) -> None:
        pass


def advance(server: Server, ticks: int, **fields: object) -> None:
    """Let the left arm answer each of `ticks` states with what it desires now, but for the given fields."""
    arm_server = server.arm_servers[0]
    for _ in range(ticks):
        server.advance()
        arm_server.show_new()
        command, wire = np.zeros(1, ROBOT_COMMAND)[0], arm_server._wire[0]
        command["message_id"] = arm_server.message_id
        for name in ("q_c", "O_T_EE_c", "elbow_c"):
            command[name] = wire["q_d" if name == "q_c" else name]
        for name, value in fields.items():
            command[name] = value
        arm_server.take(command)


def test_nothing_is_compiled_once_the_clock_runs(server: Server) -> None:
    left, listener = server.arm_servers[0], Compilations()
    with event.install_listener("numba:compile", listener):
        for controller, generator in itertools.product(Controller, Generator):
            if controller != Controller.OTHER and (generator != Generator.NONE or controller == Controller.EXTERNAL):
                left.handle(Command.MOVE, 1, move_values(controller, generator))
                assert left.moving, (controller, generator)
                advance(server, 3, valid_elbow=generator == Generator.CARTESIAN_POSITION)
                server.advance()  # a lost packet
                advance(server, 3)
                assert left.moving, (controller, generator, error_names(left.box.errors))
                advance(server, 1, motion_generation_finished=1)
                assert not left.moving
        left.handle(Command.MOVE, 1, move_values(Controller.JOINT_IMPEDANCE, Generator.JOINT_POSITION, 1))
        advance(server, 5)
        left.handle(Command.STOP_MOVE, 1, ())
        thresholds = np.concatenate([[5.0] * 7, [80.0] * 7] * 2 + [[5.0] * 6, [20.0] * 6] * 2)
        left.handle(Command.SET_COLLISION_BEHAVIOR, 1, tuple(thresholds))
        server.cell.plant.push(0, np.array([0.0, 0.0, 30.0]))
        left.handle(Command.MOVE, 1, move_values(Controller.EXTERNAL, Generator.NONE))
        advance(server, 60)
        assert "cartesian_reflex" in error_names(left.box.errors)
        server.cell.plant.push(0, np.zeros(3))
        advance(server, 500)
        left.handle(Command.AUTOMATIC_ERROR_RECOVERY, 1, ())
        advance(server, 2)
        assert not left.box.errors
        for command, values in (
            (Command.SET_JOINT_IMPEDANCE, (500.0,) * 7),
            (Command.SET_CARTESIAN_IMPEDANCE, (500.0,) * 3 + (50.0,) * 3),
            (Command.SET_LOAD, (0.1, *(0.0,) * 12)),
        ):
            left.handle(command, 1, values)
        advance(server, 2)
    assert listener.names == []


def errors(arm_server: ArmServer) -> tuple[str, ...]:
    return error_names(arm_server.box.errors)


def assert_recovery(server: Server, refused: bool) -> None:
    """Ask the left arm to end its motion, which clears nothing, and to recover."""
    arm_server = server.arm_servers[0]
    reasons = errors(arm_server)
    arm_server.handle(Command.STOP_MOVE, 1, ())
    advance(server, 2)
    assert errors(arm_server) == reasons
    arm_server.handle(Command.AUTOMATIC_ERROR_RECOVERY, 1, ())
    advance(server, 2)
    assert errors(arm_server) == (reasons if refused else ())


def test_a_push_that_lasts_refuses_the_recovery(server: Server) -> None:
    left, wire = server.arm_servers[0], server.arm_servers[0]._wire[0]
    thresholds = np.concatenate([[8.0] * 7, [80.0] * 7] * 2 + [[8.0] * 6, [20.0] * 6] * 2)
    left.handle(Command.SET_COLLISION_BEHAVIOR, 1, tuple(thresholds))
    left.handle(Command.MOVE, 1, move_values(Controller.EXTERNAL, Generator.NONE))
    server.cell.plant.push(0, np.array([0.0, 0.0, 30.0]))
    advance(server, 600)  # until then the arm may still come to rest
    assert errors(left) == ("cartesian_reflex",)
    assert wire["cartesian_contact"].max() == wire["cartesian_collision"].max() == 1.0
    assert_recovery(server, refused=True)
    server.cell.plant.push(0, np.zeros(3))
    advance(server, 500)
    assert wire["cartesian_contact"].max() == 0.0
    assert wire["cartesian_collision"].max() == 1.0  # latched
    assert_recovery(server, refused=False)
    assert wire["cartesian_collision"].max() == 0.0


def test_an_arm_that_stays_too_near_refuses_the_recovery(server: Server) -> None:
    """The hand's link next to the table, put there: the arm stops before it gets so near by itself."""
    plant, left = server.cell.plant, server.arm_servers[0]
    home, q = plant.data.qpos[:7].copy(), plant.data.qpos[:7].copy()

    def put(posture: np.ndarray) -> None:
        motor = plant.motors[0]
        for name in ("theta", "theta_hold"):
            motor[name] += posture - plant.data.qpos[:7]
        plant.data.qpos[:7], plant.data.qvel[:] = posture, 0.0
        mujoco.mj_forward(plant.model, plant.data)

    way = np.array([-0.28, -0.03, -0.19, -2.88, -1.35, 0.76, 1.09]) - home
    while not left.proximity.too_near(0):
        q += 2e-3 * way
        put(q)
        for _ in range(100):  # the gears wind up anew
            server.advance()
    left.handle(Command.MOVE, 1, move_values(Controller.EXTERNAL, Generator.NONE))
    advance(server, 2)
    assert errors(left) == ("self_collision_avoidance_violation",)
    assert_recovery(server, refused=True)
    put(home)
    advance(server, 100)
    assert_recovery(server, refused=False)


def test_torque_control_desires_nothing_before_its_first_torque(server: Server) -> None:
    left, wire, tau = server.arm_servers[0], server.arm_servers[0]._wire[0], np.full(7, 0.5)
    advance(server, 5)
    assert not wire["tau_J_d"].any()  # idle: what holds the arm is nobody's command
    left.handle(Command.MOVE, 1, move_values(Controller.EXTERNAL, Generator.NONE))
    for _ in range(3):
        server.advance()
        left.show_new()
        assert left.moving
        assert not wire["tau_J_d"].any()
    advance(server, 2, tau_J_d=tau)
    assert np.array_equal(wire["tau_J_d"], tau)
    left.handle(Command.STOP_MOVE, 1, ())
    left.handle(Command.MOVE, 1, move_values(Controller.JOINT_IMPEDANCE, Generator.JOINT_POSITION))
    advance(server, 2)
    assert wire["tau_J_d"].any()  # of the robot's own controller


def test_every_error_is_raised_or_said_never_to_be() -> None:
    """By the table of the documentation, which says what raises each."""
    sources = [path.read_text() for path in Path(sim_robot.__file__).parent.rglob("*.py")]
    raised = {name for name in ROBOT_ERRORS if any(f'error_bit("{name}")' in text for text in sources)}
    table = tomllib.loads((Path(sim_robot.__file__).parents[1] / "docs/generate/fidelity.toml").read_text())["errors"]
    assert raised == {name for name, entry in table.items() if "by" in entry}
    assert len(raised) == 35


@contextlib.contextmanager
def served(server: Server, longest_wait_s: float) -> Iterator[None]:
    """Let a thread serve in lockstep."""
    ended = threading.Event()
    serving = threading.Thread(target=Lockstep(server, longest_wait_s).run, args=(ended.is_set,))
    serving.start()
    try:
        yield
    finally:
        ended.set()
        serving.join()


def start_torque_control(client: RawClient) -> None:
    client.connect()
    assert client.move() == MoveStatus.MOTION_STARTED


def answered(client: RawClient) -> np.void:
    """Return the next state, once it is answered without a torque."""
    state = client.next_state()
    client.command(state)
    return state


def test_lockstep_does_not_wait_for_a_client_that_hangs(server: Server, addresses: tuple[str, str]) -> None:
    """Its arm loses 20 packets and stops; the other arm's client loses none."""
    with served(server, 1.0), RawClient(addresses[0]) as hanging, RawClient(addresses[1]) as alive:
        for client in (hanging, alive):
            start_torque_control(client)
        for _ in range(3):  # by turns: who has not answered yet is waited for, and would be taken for hanging
            for client in (hanging, alive):
                answered(client)
        rates = []
        for _ in range(300):
            state = answered(alive)
            if state["robot_mode"] == RobotMode.MOVE:  # older ones may wait to be read
                rates.append(state["control_command_success_rate"])
            if server.arm_servers[0].box.errors:
                break
        assert error_names(server.arm_servers[0].box.errors) == ("communication_constraints_violation",)
        assert hanging.answer()[2] == bytes((MoveStatus.REFLEX_ABORTED,))
        assert state["robot_mode"] == RobotMode.MOVE
        assert set(rates) == {1.0}


def test_lockstep_waits_from_the_beginning_of_a_motion_on(server: Server, addresses: tuple[str, str]) -> None:
    """However long the robot stood idle before: nobody owed it an answer then."""
    with served(server, longest_wait_s := 1.0), RawClient(addresses[0]) as client:
        time.sleep(longest_wait_s + 0.1)  # the fault itself
        start_torque_control(client)
        time.sleep(0.1)  # 20 lost packets take the plant some 5 ms
        while (state := answered(client))["robot_mode"] == RobotMode.IDLE:
            continue
        for _ in range(30):
            state = answered(client)
        assert state["robot_mode"] == RobotMode.MOVE
        assert state["control_command_success_rate"] == 1.0
