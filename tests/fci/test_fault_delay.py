"""A fault is reported within two cycles of its condition: counted in message ids, read from the bytes."""

import socket
from collections.abc import Callable

import numpy as np
import pytest
from fci_client import DAMPING, STIFFNESS, connect, go_home
from fci_raw import RawClient
from fci_server import Served

from hal.limits import FR3
from hal.robot_errors import ROBOT_ERRORS
from hal.state import RobotMode
from sim_robot.fci.protocol import ROBOT_STATE, Command, MoveStatus
from sim_robot.plant_parameters import load_plant_parameters

CYCLES = 2
LOST_PACKETS = 20
WARM_UP = 20
Law = Callable[[int, np.void], np.ndarray | None]


def until_reflex(raw: RawClient, law: Law, most: int) -> list[np.void]:
    """Answer each state with law(tick, state), or not at all, until one shows a reflex; every state, oldest first."""
    raw.connect()
    raw.send(Command.AUTOMATIC_ERROR_RECOVERY)
    assert raw.answer()[2] == b"\x00"
    assert raw.move() == MoveStatus.MOTION_STARTED
    states = [raw.state()]
    while states[-1]["robot_mode"] != RobotMode.REFLEX:
        assert len(states) <= most, "no reflex"
        tau = law(len(states) - 1, states[-1])
        if tau is not None:
            raw.command(states[-1], tau_J_d=tau)
        states.append(np.frombuffer(raw.udp.recvfrom(4096)[0], ROBOT_STATE)[0])
    raw.tcp.shutdown(socket.SHUT_WR)
    while raw.tcp.recv(4096):  # until the server has let go of this client
        continue
    return states


def recover_and_go_home(address: str) -> None:
    robot = connect(address)
    robot.automatic_error_recovery()
    go_home(robot)


def names(state: np.void) -> set[str]:
    return {name for name, raised in zip(ROBOT_ERRORS, state["reflex_reason"], strict=True) if raised}


def held(state: np.void, q_hold: np.ndarray) -> np.ndarray:
    return STIFFNESS * (q_hold - state["q"]) - DAMPING * state["dq"]


def cycles_since(states: list[np.void], condition: Callable[[np.void], bool]) -> int:
    """Message ids from the first state that shows the condition to the one that shows the reflex."""
    first = next(state for state in states if condition(state))
    return int(states[-1]["message_id"]) - int(first["message_id"])


@pytest.mark.parametrize(("joint", "value"), [(3, np.nan), (3, np.inf), (1, 200.0), (7, 1.1)])
def test_a_bad_torque(lockstep: Served, joint: int, value: float) -> None:
    tau = np.zeros(7)
    tau[joint - 1] = value
    with RawClient(lockstep.right) as raw:
        states = until_reflex(raw, lambda tick, state: tau if tick >= WARM_UP else np.zeros(7), 100)
    bad = states[WARM_UP]["message_id"]
    assert cycles_since(states, lambda state: state["message_id"] == bad) <= CYCLES
    assert names(states[-1]) == {"controller_torque_discontinuity"}


def test_a_joint_that_is_too_fast(lockstep: Served) -> None:
    go_home(connect(lockstep.left))
    tau, spare = np.zeros(7), load_plant_parameters().reflexes.velocity_tolerance

    def push(tick: int, state: np.void) -> np.ndarray:
        tau[0] = -min(0.2 * tick, 30.0)
        return tau

    def too_fast(state: np.void) -> bool:
        room = np.sqrt(2.0 * FR3.deceleration * np.maximum(state["q"] - FR3.q_lower, 0.0)) - FR3.velocity_offset
        return bool(np.any(-state["dq"] - spare > np.minimum(FR3.dq_max, np.maximum(0.0, room))))

    with RawClient(lockstep.left) as raw:
        states = until_reflex(raw, push, 2000)
    assert cycles_since(states, too_fast) <= CYCLES
    assert names(states[-1]) == {"joint_velocity_violation"}
    recover_and_go_home(lockstep.left)


def test_a_contact_above_its_threshold(lockstep: Served) -> None:
    robot = connect(lockstep.left)
    go_home(robot)
    force = 15.0
    robot.set_collision_behavior([5.0] * 7, [100.0] * 7, [4.0] * 6, [force] * 6)
    del robot
    goal: list[np.ndarray] = []

    def lower(tick: int, state: np.void) -> np.ndarray:
        if not goal:
            goal.append(np.array(state["q"], dtype=float))
        goal[0][1] += 2e-4
        return held(state, goal[0])

    with RawClient(lockstep.left) as raw:
        states = until_reflex(raw, lower, 3000)
    pressed = cycles_since(states, lambda state: bool(np.any(np.abs(state["O_F_ext_hat_K"]) > force)))
    assert pressed <= CYCLES
    assert names(states[-1]) == {"cartesian_reflex"}
    robot = connect(lockstep.left)
    robot.automatic_error_recovery()
    robot.set_collision_behavior([20.0] * 7, [100.0] * 7, [20.0] * 6, [250.0] * 6)
    go_home(robot)


@pytest.mark.realtime
def test_a_client_that_falls_silent(realtime: Served) -> None:
    """The vendor's 20 packets, counted in states of the robot's own clock."""
    with RawClient(realtime.right) as raw:
        states = until_reflex(raw, lambda tick, state: np.zeros(7) if tick < WARM_UP else None, 200)
    silent = states[WARM_UP]["message_id"]
    assert cycles_since(states, lambda state: state["message_id"] == silent) <= LOST_PACKETS + CYCLES
    assert names(states[-1]) == {"communication_constraints_violation"}
