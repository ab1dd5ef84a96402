"""What Desk was told decides what the Franka Control Interface takes, and programs of other authors can tell it."""

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pylibfranka
import pytest

from hal.desk import DeskError, Trust
from hal.desk.power import start
from hal.errors import CommandRejected, ConnectionLost, RecoveryRefused
from hal.fci.arm import FciArm
from tests.support.desk import SIGN_IN, desk_address, desk_of
from tests.support.fci.server import Served, serve


@pytest.fixture(params=[("--lockstep",), ("--priority=0",)], ids=["lockstep", "realtime"])
def boxes(request) -> Iterator[Served]:
    with serve("--desk", *request.param) as served:
        yield served


@pytest.fixture
def franky(boxes) -> Iterator[Any]:
    """franky's Desk, as its author published it; the file alone, since its library excludes pylibfranka."""
    package = find_spec("franky")
    assert package is not None
    assert package.origin is not None
    spec = spec_from_file_location("franky_desk", Path(package.origin).with_name("desk.py"))
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclasses look themselves up there
    spec.loader.exec_module(module)
    with module.Desk(desk_address(boxes.left), SIGN_IN.user, SIGN_IN.password) as desk:
        yield desk
    del sys.modules[spec.name]


def until(there: Callable[[], bool]) -> None:
    while not there():
        time.sleep(0.01)


def connected(address: str) -> FciArm:
    """Return the arm, once its FCI has heard of what Desk was told."""
    while True:
        with contextlib.suppress(ConnectionLost):
            return FciArm(address)
        time.sleep(0.01)


def mode(arm: FciArm) -> str:
    return arm.read().robot_mode.name


def test_franky_lets_the_arm_move_and_locks_it_again(boxes, franky):
    with pytest.raises(ConnectionLost, match="Connection to FCI refused"):
        FciArm(boxes.left)
    franky.take_control(wait_timeout=1)
    franky.unlock_brakes()
    franky.set_mode_execution()
    franky.enable_fci()
    assert (franky.brake_state.value, franky.get_fci_status(), franky.has_control) == ("Unlocked", "Active", True)
    arm = connected(boxes.left)
    try:
        until(lambda: mode(arm) == "IDLE")
        franky.lock_brakes()
        until(lambda: mode(arm) == "OTHER")
        with pytest.raises(CommandRejected, match="not possible in the current mode"):
            arm.start()
        with pytest.raises(RecoveryRefused, match="unlock the joints"):
            arm.recover()
        franky.unlock_brakes()
        until(lambda: mode(arm) == "IDLE")
        arm.start()
    finally:
        arm.close()


def test_fci_that_is_ended_ends_the_motion_and_the_connection(boxes, franky):
    franky.take_control(wait_timeout=1)
    franky.unlock_brakes()
    franky.enable_fci()
    connected(boxes.left).close()
    robot = pylibfranka.Robot(boxes.left, pylibfranka.RealtimeConfig.kIgnore)
    control = robot.start_torque_control()
    franky.disable_fci()
    with pytest.raises(Exception, match=r"interrupted|closed|UDP|Preempted|preempted|not reachable|refused"):  # noqa: PT012
        while True:
            control.readOnce()
            control.writeOnce(pylibfranka.Torques([0.0] * 7))
    with pytest.raises(ConnectionLost, match="Connection to FCI refused"):
        FciArm(boxes.left)


def test_franky_runs_the_self_test(boxes, franky):
    franky.take_control(wait_timeout=1)
    franky.execute_self_test()
    assert franky.get_recovery_status() is None
    assert franky.operating_mode.value == "Execution"


def test_one_program_at_a_time_has_control(boxes, franky):
    franky.take_control(wait_timeout=1)
    other = type(franky)(desk_address(boxes.left), SIGN_IN.user, SIGN_IN.password)
    other.open()
    with pytest.raises(Exception, match="Timed out after 1s"):
        other.take_control(wait_timeout=1)
    franky.release_control()
    other.take_control(wait_timeout=1)
    assert other.has_control
    other.close()


def test_an_fci_that_a_script_has_off_stays_off_whatever_desk_was_told(tmp_path):
    script = tmp_path / "off.toml"
    script.write_text('[[fault]]\nkind = "mode"\narm = "left"\nstate = "fci_off"\n')
    trust = Trust(tmp_path)
    with serve("--desk", "--lockstep", f"--faults={script}") as served:
        for address in (served.left, served.right):
            with contextlib.closing(desk_of(address, trust)) as desk:
                list(start(desk, trust, desk_address(address)))
        connected(served.right).close()  # both boxes look at Desk in the same millisecond
        with pytest.raises(ConnectionLost, match="Connection to FCI refused"):
            FciArm(served.left)


def test_a_stop_that_is_pressed_shows_on_desk_and_lets_nothing_be_unlocked(tmp_path):
    script = tmp_path / "stop.toml"
    script.write_text('[[fault]]\nkind = "user_stop"\narm = "left"\nat_s = 0.05\nduration_s = 600.0\n')
    trust = Trust(tmp_path)
    with serve("--desk", "--lockstep", f"--faults={script}") as served:
        address = desk_address(served.left)
        with contextlib.closing(desk_of(served.left, trust)) as desk:
            list(start(desk, trust, address))
            arm = connected(served.left)
            with pytest.raises(CommandRejected):  # noqa: PT012
                while True:
                    arm.read()
                    arm.write(np.zeros(7))
            until(lambda: desk.state().operating_mode == "SafetyRecovery")
            with pytest.raises(DeskError, match="its stop is pressed: look why, then release it"):
                list(start(desk, trust, address))
            desk.lock()
            with pytest.raises(DeskError, match=r"EmergencyStopPressed: the stop is pressed.*: release it first"):
                desk.unlock()
            arm.close()
