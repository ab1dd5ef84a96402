"""Unmodified clients of the Franka Hand, with a hand (left arm) and without one (right arm)."""

import socket
import subprocess
import sys
import threading
from collections.abc import Iterator

import numpy as np
import pylibfranka as franka
import pytest

from hal.errors import ConnectionLost, GripperFailed, NoGripper
from hal.fci.gripper import FciGripper, ask_for_gripper
from hal.wire import GRIPPER_PORT
from rtstack.check.network import gripper_finding
from tests.support.fci.client import connect, hold, program_path, torque_control
from tests.support.fci.server import Served, serve

SCENE = ("--scene", "hand", "--object", "block")


@pytest.fixture
def with_hand() -> Iterator[Served]:
    """A lockstep server whose left arm has a hand."""
    with serve("--lockstep", *SCENE) as served:
        yield served


def run(program: str, *arguments: str) -> str:
    path = program_path(program)
    finished = subprocess.run(
        [sys.executable, str(path), *arguments], capture_output=True, text=True, timeout=120, check=False
    )
    assert finished.returncode == 0, finished.stdout + finished.stderr
    return finished.stdout


@pytest.mark.parametrize("pace", [("--lockstep",), ("--priority", "0")])
def test_the_vendors_grasp(pace: tuple[str, ...]) -> None:
    with serve(*pace, *SCENE) as served:
        said = run("grasp_object", served.left)
    assert said.splitlines() == ["not homed: libfranka gripper: Command failed!", "grasped", "let go at 0.08"]


def test_frankys_hand(with_hand: Served) -> None:
    assert run("franky_gripper", with_hand.left).splitlines() == [
        "grasped 0.05",
        "stopped: libfranka gripper: Command aborted!",
        "out of range: libfranka gripper: Command failed!",
    ]


REFUSED = "libfranka: Protocol error during connection attempt"


def test_without_a_hand_pylibfranka_and_franky_are_told(with_hand: Served) -> None:
    with pytest.raises(franka.FrankaException, match=REFUSED):
        franka.Gripper(with_hand.right)
    program = (
        f"import franky\ntry:\n  franky.Gripper({with_hand.right!r})\nexcept franky.ProtocolException as e: print(e)"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert said.stdout.strip() == REFUSED


def test_hals_gripper(with_hand: Served) -> None:
    assert ask_for_gripper(with_hand.left) == 3
    gripper = FciGripper(with_hand.left)
    with pytest.raises(GripperFailed, match="Is it homed"):
        gripper.move(0.05, 0.1)
    assert gripper.homing()
    assert gripper.grasp(0.05, 0.1, 30.0)
    before, after = gripper.state(), gripper.state()
    assert (after.is_grasped, after.max_width, after.temperature) == (True, pytest.approx(0.08), 25)
    assert after.t_ns > before.t_ns
    assert gripper.stop()
    assert not gripper.grasp(0.02, 0.1, 30.0)
    gripper.close()
    gripper.close()
    with pytest.raises(ConnectionLost, match="closed"):
        gripper.homing()


def test_hal_says_that_there_is_no_hand(with_hand: Served) -> None:
    with pytest.raises(NoGripper, match=f"{with_hand.right} has no hand"):
        FciGripper(with_hand.right)


def test_hal_does_not_wait_for_ever_where_libfranka_would(with_hand: Served) -> None:
    """Someone accepts, reads and hangs up: libfranka's constructor would never return."""
    with socket.create_server((with_hand.left.replace("127.", "127.2", 1), GRIPPER_PORT)) as listener:
        address = listener.getsockname()[0]

        def hang_up() -> None:
            tcp, _ = listener.accept()
            with tcp:
                tcp.recv(100)

        thread = threading.Thread(target=hang_up)
        thread.start()
        with pytest.raises(ConnectionLost, match="hung up"):
            FciGripper(address)
        thread.join()
    with pytest.raises(ConnectionLost, match="no gripper answers"):
        FciGripper(address)


def test_the_hand_belongs_to_the_arms_state(with_hand: Served) -> None:
    """What Desk would have set for the hand: mass, centre, and the fingertips, turned by -45 degrees."""
    state = connect(with_hand.left).read_once()
    assert state.m_ee == pytest.approx(0.73)
    assert state.F_x_Cee == pytest.approx((-0.01, 0.0, 0.03))
    assert state.F_T_NE[12:15] == pytest.approx((0.0, 0.0, 0.1034))
    assert state.F_T_NE[:2] == pytest.approx((0.5**0.5, -(0.5**0.5)), abs=1e-6)  # the first column
    assert state.O_T_EE[12:15] == pytest.approx((0.4, -0.5, 0.27), abs=2e-3)
    assert state.O_T_EE[4:7] == pytest.approx((0.0, -1.0, 0.0), abs=5e-3)  # the fingers, along the world's y
    assert connect(with_hand.right).read_once().m_ee == pytest.approx(0.35)


def test_an_arm_goes_on_in_torque_control_while_the_hand_grasps(with_hand: Served) -> None:
    """The gripper's program is another process; the plant keeps the pace of the arm's answers."""
    robot = connect(with_hand.left)
    q_hold = np.array(robot.read_once().q)
    program = program_path("grasp_object")
    command = [sys.executable, str(program), with_hand.left]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        while process.poll() is None:
            states = torque_control(robot, 500, lambda tick, state: hold(state, q_hold))
            assert states[-1].robot_mode == franka.RobotMode.Move
        said, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    assert said.splitlines()[-1] == "let go at 0.08"


def test_a_check_says_whether_a_hand_answers_and_asks_for_none(with_hand: Served) -> None:
    left, right = (gripper_finding("gripper", address) for address in (with_hand.left, with_hand.right))
    nobody = gripper_finding("gripper", "127.0.97.43")
    assert (left.value, right.value) == ("a Franka Hand answers, version 3", "none is mounted")
    assert "no gripper answers at 127.0.97.43" in nobody.value
    assert {left.verdict, right.verdict, nobody.verdict} == {"pass"}
