"""Scripted faults as a client on the wire meets them, in lockstep."""

import contextlib
import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hal.state import RobotMode
from sim_robot.fci.protocol import Command, MoveStatus
from tests.support.fci.raw import RawClient, errors_of
from tests.support.fci.server import Served, serve

AT_S = 0.05
BEFORE = 50  # states that answers were good for


@pytest.fixture
def script(tmp_path: Path):
    """Serve with one fault on the left arm, at 0.05 s."""

    @contextlib.contextmanager
    def served(kind: str, keys: str = 'arm = "left"', *arguments: str) -> Iterator[Served]:
        path = tmp_path / "faults.toml"
        path.write_text(f'[[fault]]\nkind = "{kind}"\nat_s = {AT_S}\n{keys}\n', encoding="utf-8")
        with serve("--lockstep", "--faults", str(path), *arguments) as server:
            yield server

    return served


def answered(raw: RawClient, ticks: int) -> list[np.void]:
    """Begin torque control, answer with zero torque for some ms, and return every new state."""
    states = [raw.begin()]
    for _ in range(ticks):
        raw.command(states[-1])
        state = raw.state()
        while state["message_id"] <= states[-1]["message_id"] or state["q"].tobytes() == states[0]["q"].tobytes():
            raw.command(state)
            state = raw.state()
        states.append(state)
    return states


def test_lost_answers_are_lost_packets(script) -> None:
    with script("answers_lost", 'arm = "left"\nduration_s = 0.01') as served, RawClient(served.left) as raw:
        rates = [round(float(state["control_command_success_rate"]), 2) for state in answered(raw, 100)]
    # the state after the ms in which it begins is the first whose answer is lost
    assert set(rates[: BEFORE + 2]) == {1.0}
    assert rates[BEFORE + 2 : BEFORE + 12] == [round(1.0 - 0.01 * n, 2) for n in range(1, 11)]
    assert rates[-1] == 0.9


def test_twenty_lost_answers_are_a_reflex(script) -> None:
    with script("answers_lost") as served, RawClient(served.left) as raw:
        state = raw.begin()
        while state["robot_mode"] == RobotMode.MOVE:
            raw.command(state)
            state = raw.state()
        assert raw.answer()[2][0] == MoveStatus.REFLEX_ABORTED
    assert errors_of(state) == {"communication_constraints_violation"}


def test_lost_states_are_missing_and_the_robot_goes_on(script) -> None:
    with script("states_lost", 'arm = "left"\nduration_s = 0.01') as served, RawClient(served.left) as raw:
        states = answered(raw, 80)
    gaps = np.diff([int(state["message_id"]) for state in states])
    assert gaps[gaps > 1].tolist()[-1:] == [11]
    assert states[-1]["control_command_success_rate"] == pytest.approx(0.9)
    assert states[-1]["robot_mode"] == RobotMode.MOVE


def test_a_frozen_state_on_the_wire(script) -> None:
    with script("state_frozen", 'arm = "left"\nduration_s = 0.01') as served, RawClient(served.left) as raw:
        state = raw.begin()
        seen = []
        for _ in range(100):
            raw.command(state)
            state = raw.state()
            seen.append((int(state["message_id"]), state["dq"].tobytes()))
    ids = [one[0] for one in seen]
    assert ids == sorted(set(ids))
    repeated = [a[1] == b[1] for a, b in itertools.pairwise(seen[5:])]
    assert sum(repeated) == 9
    assert repeated.index(True) in range(BEFORE - 10, BEFORE + 1)


def test_a_closed_connection(script) -> None:
    with script("disconnect") as served:
        with RawClient(served.left) as raw:
            states = answered(raw, BEFORE)
            raw.command(states[-1])
            with pytest.raises(ConnectionResetError):
                raw.answer()
        # the robot loses the client's packets from then on, and a new client finds it so
        with RawClient(served.left) as raw:
            raw.connect()
            state = raw.state()
            while state["robot_mode"] == RobotMode.MOVE:
                state = raw.state()
    assert errors_of(state) == {"communication_constraints_violation"}


def test_a_server_that_stalls_goes_on(script) -> None:
    with script("stall", "stall_ms = 300.0") as served, RawClient(served.left) as raw:
        states = answered(raw, 80)
    assert states[-1]["robot_mode"] == RobotMode.MOVE
    assert states[-1]["control_command_success_rate"] == 1.0


def test_a_user_stop_ends_the_motion_and_refuses_the_next_until_it_is_released(script) -> None:
    with script("user_stop", 'arm = "left"\nduration_s = 0.3') as served, RawClient(served.left) as raw:
        state = raw.begin()
        while state["robot_mode"] == RobotMode.MOVE:
            raw.command(state)
            state = raw.state()
        assert state["robot_mode"] == RobotMode.USER_STOPPED
        command, _, body = raw.answer()
        assert (command, body[0]) == (Command.MOVE, MoveStatus.EMERGENCY_ABORTED)
        assert raw.move() == MoveStatus.NOT_POSSIBLE
        raw.send(Command.AUTOMATIC_ERROR_RECOVERY)
        assert raw.answer()[2][0] != 0
        # released, although the plant of a lockstep server stands still
        while state["robot_mode"] == RobotMode.USER_STOPPED:
            state = raw.state()
        assert state["robot_mode"] == RobotMode.IDLE
        assert raw.move() == MoveStatus.MOTION_STARTED


def test_a_reflex_is_recovered_once_its_cause_is_gone(script) -> None:
    keys = 'arm = "left"\nduration_s = 0.3\nerror = "cartesian_reflex"'
    with script("reflex", keys) as served, RawClient(served.left) as raw:
        state = raw.begin()
        while state["robot_mode"] == RobotMode.MOVE:
            raw.command(state)
            state = raw.state()
        assert raw.answer()[2][0] == MoveStatus.REFLEX_ABORTED
        assert errors_of(state) == {"cartesian_reflex"}
        tries = []
        while not tries or tries[-1] != 0:
            raw.send(Command.AUTOMATIC_ERROR_RECOVERY)
            tries.append(raw.answer()[2][0])
        assert len(tries) > 1
        assert raw.move() == MoveStatus.MOTION_STARTED
