"""Modes out of which only a person leads, as a client on the wire meets them, and what it is told to do."""

import contextlib
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hal.errors import CommandRejected, ConnectionLost, HardwareError, RecoveryRefused
from hal.fci import FciPair, open_pair
from hal.state import RobotMode
from sim_robot.cell import simulated_cell
from sim_robot.faults.file import load_faults
from sim_robot.fci.protocol import Command, MoveStatus, RecoveryStatus, SetStatus, StopStatus
from tests.support.fci.raw import RawClient
from tests.support.fci.server import Served, serve


def _script(folder: Path, state: str, more: str = "") -> Path:
    path = folder / "faults.toml"
    path.write_text(f'[[fault]]\nkind = "mode"\narm = "left"\nstate = "{state}"\n{more}', encoding="utf-8")
    return path


@contextlib.contextmanager
def _pair(path: Path) -> Iterator[tuple[Served, FciPair]]:
    with serve("--lockstep", "--faults", str(path)) as served:
        pair = open_pair(served.left, served.right, shared_clock=True)
        yield served, pair
        pair.close()


@pytest.mark.parametrize(
    ("state", "mode", "remedy"),
    [
        ("guiding", RobotMode.GUIDING, "let go of the buttons at its wrist"),
        ("brakes_locked", RobotMode.OTHER, "on its Desk page unlock the joints"),
    ],
)
def test_an_arm_that_a_person_has_in_hand_refuses_move_and_recovery(tmp_path, state, mode, remedy) -> None:
    with _pair(_script(tmp_path, state)) as (_, pair):
        assert pair.left.read().robot_mode is mode
        assert pair.right.read().robot_mode is RobotMode.IDLE
        with pytest.raises(CommandRejected, match=f"not possible in the current mode.*{remedy}"):
            pair.start()
        with pytest.raises(RecoveryRefused, match=remedy):
            pair.recover()


@pytest.mark.parametrize("state", ["self_test_due", "safety_function"])
def test_a_safety_function_refuses_whatever_changes_something(tmp_path, state) -> None:
    with serve("--lockstep", "--faults", str(_script(tmp_path, state))) as served:
        with pytest.raises(
            CommandRejected, match=r"safety function.*remove the rules of Watchman, or do the self-test"
        ):
            open_pair(served.left, served.right)
        with RawClient(served.left) as raw:
            raw.connect()
            assert raw.move() == 4  # rejected due to activated safety functions
            raw.send(Command.SET_JOINT_IMPEDANCE, struct.pack("<7d", *[3000.0] * 7))
            assert raw.answer()[2] == bytes((SetStatus.SAFETY,))
            raw.send(Command.AUTOMATIC_ERROR_RECOVERY)
            assert raw.answer()[2] == bytes((RecoveryStatus.SAFETY,))


def _stop(raw: RawClient) -> StopStatus:
    raw.send(Command.STOP_MOVE)
    command, _, body = raw.answer()
    assert command == Command.STOP_MOVE
    return StopStatus(body[0])


@pytest.mark.parametrize("profile", ["ideal", "honest", "harsh"])
def test_a_stop_is_answered_by_the_arm_s_mode(profile) -> None:
    with serve("--lockstep", "--profile", profile) as served, RawClient(served.left) as raw:
        raw.connect()
        assert _stop(raw) is StopStatus.NOT_POSSIBLE  # idle
        assert raw.move() == MoveStatus.MOTION_STARTED
        raw.command(raw.moving_state())
        raw.send(Command.STOP_MOVE)
        assert [raw.answer()[::2] for _ in range(2)] == [
            (Command.MOVE, bytes((MoveStatus.PREEMPTED,))), (Command.STOP_MOVE, bytes((StopStatus.SUCCESS,))),
        ]  # fmt: skip
        assert raw.move() == MoveStatus.MOTION_STARTED
        state = raw.moving_state()
        while state["robot_mode"] == RobotMode.MOVE:
            raw.command(state, tau_J_d=40.0)
            state = raw.state()
        assert raw.answer()[2][0] == MoveStatus.REFLEX_ABORTED
        for _ in range(2):  # which clears nothing
            assert _stop(raw) is StopStatus.REFLEX_ABORTED
        assert raw.state()["robot_mode"] == RobotMode.REFLEX


@pytest.mark.parametrize(
    ("script", "status"),
    [
        ('kind = "user_stop"\nat_s = 0.005', StopStatus.EMERGENCY_ABORTED),
        ('kind = "mode"\nstate = "safety_function"', StopStatus.SAFETY),
        ('kind = "mode"\nstate = "guiding"', StopStatus.NOT_POSSIBLE),
        ('kind = "mode"\nstate = "brakes_locked"', StopStatus.NOT_POSSIBLE),
    ],
)
def test_a_stop_of_an_arm_that_needs_a_person_names_the_cause(tmp_path, script, status) -> None:
    (tmp_path / "faults.toml").write_text(f'[[fault]]\narm = "left"\n{script}')
    with serve("--lockstep", "--faults", str(tmp_path / "faults.toml")) as served, RawClient(served.left) as raw:
        if "at_s" in script:
            state = raw.begin()
            while state["robot_mode"] == RobotMode.MOVE:
                raw.command(state)
                state = raw.state()
            assert raw.answer()[2][0] == MoveStatus.EMERGENCY_ABORTED
        else:
            raw.connect()
            while raw.state()["robot_mode"] == RobotMode.IDLE:
                continue
        assert _stop(raw) is status


@pytest.mark.parametrize("profile", ["ideal", "honest", "harsh"])
def test_our_client_survives_each_refusal_of_a_stop(profile) -> None:
    """libfranka stops an idle arm once more, when the motion's object is dropped; refused, it believes the motion to go
    on until it sees a later state."""
    with serve("--lockstep", "--profile", profile) as served:
        pair = open_pair(served.left, served.right, shared_clock=True)
        for _ in range(3):
            pair.start()
            _answer(pair, 0.0)
            pair.stop()
        assert (pair.left.reflex(), pair.right.reflex()) == ((), ())
        pair.start()
        with pytest.raises(CommandRejected, match="controller_torque_discontinuity"):
            _answer(pair, 40.0)
        pair.stop()
        assert pair.left.reflex() == ("controller_torque_discontinuity",)
        pair.recover()
        pair.start()
        _answer(pair, 0.0)
        pair.close()


def _answer(pair: FciPair, torque: float) -> None:
    """Answer some states of both arms; torque: of the left one, Nm, after its first answer."""
    for k in range(5):
        for arm in (pair.left, pair.right):
            arm.read()
        for arm in (pair.left, pair.right):
            arm.write(np.full(7, torque * (k > 0 and arm is pair.left)))


def test_without_fci_there_is_no_connection(tmp_path) -> None:
    with (
        serve("--lockstep", "--faults", str(_script(tmp_path, "fci_off"))) as served,
        pytest.raises(ConnectionLost, match=r"Connection to FCI refused.*FCI mode in Desk"),
    ):
        open_pair(served.left, served.right)


def test_an_arm_that_is_guided_for_a_while_obeys_afterwards(tmp_path) -> None:
    with _pair(_script(tmp_path, "guiding", "duration_s = 0.3\n")) as (_, pair):
        while pair.left.read().robot_mode is RobotMode.GUIDING:
            pass
        pair.start()
        pair.stop(at_rest=True)
        assert pair.left.reflex() == ()


def test_the_plant_in_this_process_refuses_as_well(tmp_path) -> None:
    cell = simulated_cell("rice_box", 0.0, 0, faults=load_faults(_script(tmp_path, "brakes_locked")))
    with pytest.raises(HardwareError, match=r"left arm.*on its Desk page unlock the joints"):
        cell.left.read()
    assert cell.right.read().robot_mode is RobotMode.IDLE
    with pytest.raises(RecoveryRefused, match="on its Desk page unlock the joints"):
        cell.left.recover()
