"""The adapter against the real server, through the real client library."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path

import numpy as np
import pytest

from hal.errors import CommandRejected, ConnectionLost, HardwareError
from hal.fci import FciArm, FciPair
from hal.fci.faults import names_in
from hal.pad import Pad
from hal.state import ARM_STATE, RobotMode
from rtstack.cells.simulator import Simulator
from rtstack.testing import ServedArms
from sim_robot.cell import simulated_cell
from tests.support.fci.server import addresses, serve

PAD = Pad((0.1, 0.1, 0.03), 0.35, 0.03)
STEP = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5])


def answer_both(pair: FciPair, tau: np.ndarray) -> None:
    """One lockstep tick of both arms."""
    for arm in (pair.left, pair.right):
        arm.read()
    for arm in (pair.left, pair.right):
        arm.write(tau)


def answer_a_few(pair: FciPair, tau: np.ndarray) -> None:
    """What is wrong shows with the next state at the latest."""
    for _ in range(3):
        answer_both(pair, tau)


def test_an_arm_is_connected_to_while_other_threads_open_connections_of_their_own():
    """As the scheduler of a campaign's workers does."""
    over = threading.Event()
    kept: list[socket.socket] = []

    def open_others(server: socket.socket) -> None:
        while not over.is_set() and len(kept) < 200:
            kept.append(socket.create_connection(server.getsockname()))
            kept.append(other := socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            other.connect(server.getsockname())
            time.sleep(1e-3)

    with serve() as served, socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=open_others, args=(server,))
        thread.start()
        try:
            for _ in range(3):
                FciArm(served.left).close()
        finally:
            over.set()
            thread.join()
            for each in kept:
                each.close()


def test_the_first_state_is_the_one_of_the_plant_in_this_process(pair: FciPair):
    direct = simulated_cell("rice_box", 0.0, 0)
    for arm, twin in ((pair.left, direct.left), (pair.right, direct.right)):
        state, expected = arm.read(), twin.read()
        assert state.robot_mode == RobotMode.IDLE
        assert state.t_ns > 0
        assert state.t_ns % 1_000_000 == 0
        for name in ARM_STATE.names or ():
            if name != "t_ns":
                assert np.array_equal(state.record[name], expected.record[name]), name
        assert np.array_equal(state.O_T_EE[3], [0.0, 0.0, 0.0, 1.0])
        assert state.O_T_EE[2, 3] == pytest.approx(0.26, abs=1e-3)  # the pad's face, as the cell describes its home


def test_a_torque_step_is_echoed_and_moves_the_joint(pair: FciPair):
    pair.start()
    q_before = pair.left.read().q.copy()
    pair.right.read()
    for _ in range(2):
        pair.left.write(STEP)
        pair.right.write(STEP)
        states = pair.left.read(), pair.right.read()
    assert np.array_equal(states[0].record["tau_J_d"][0], STEP)
    assert states[0].t_ns == states[1].t_ns
    t_ns = states[0].t_ns
    for _ in range(30):
        pair.left.write(STEP)
        pair.right.write(STEP)
        states = pair.left.read(), pair.right.read()
    assert states[0].t_ns - t_ns == states[1].t_ns - t_ns == 30_000_000
    assert states[0].robot_mode == RobotMode.MOVE
    assert states[0].record["control_command_success_rate"][0] == 1.0
    moved = states[0].q - q_before
    assert moved[6] > 1e-3
    assert np.argmax(np.abs(moved)) == 6


def test_a_torque_jump_is_a_reflex_with_the_vendors_name_until_the_recovery(pair: FciPair):
    pair.start()
    answer_both(pair, np.zeros(7))
    with pytest.raises(CommandRejected, match="controller_torque_discontinuity") as caught:
        answer_a_few(pair, np.full(7, 40.0))
    assert caught.value.errors == ("controller_torque_discontinuity",)
    assert "\n" not in str(caught.value)
    pair.left.stop()
    pair.right.stop()
    with pytest.raises(CommandRejected, match="in reflex: controller_torque_discontinuity"):
        pair.left.read()
    with pytest.raises(CommandRejected, match="Reflex"):
        pair.left.write(np.zeros(7))
    pair.left.recover()
    pair.right.recover()
    assert pair.left.read().robot_mode == RobotMode.IDLE
    pair.start()
    answer_both(pair, STEP)
    answer_both(pair, STEP)
    assert pair.left.read().robot_mode == RobotMode.MOVE


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_torque_that_is_no_number_is_refused(pair: FciPair, bad: float):
    pair.start()
    pair.left.read()
    with pytest.raises(CommandRejected, match="NaN"):
        pair.left.write(np.full(7, bad))


def test_stop_and_close_may_be_called_twice(pair: FciPair):
    pair.start()
    answer_both(pair, STEP)
    for arm in (pair.left, pair.right):
        arm.stop()
        arm.stop()
        assert arm.read().robot_mode == RobotMode.IDLE
        arm.close()
        arm.close()
        with pytest.raises(ConnectionLost, match="was closed"):
            arm.read()


def test_a_server_that_dies_is_a_lost_connection(pair: FciPair, served_arms: ServedArms):
    pair.start()
    answer_both(pair, STEP)
    os.kill(served_arms.pid, signal.SIGKILL)
    with pytest.raises(ConnectionLost, match=served_arms.left):
        answer_a_few(pair, STEP)
    with pytest.raises(ConnectionLost, match="was lost"):
        pair.left.write(STEP)
    pair.left.stop()


def test_an_arm_that_sends_nothing_any_more_is_stale(pair: FciPair):
    pair.start()
    answer_both(pair, STEP)
    pair.left.read()
    pair.right.read()
    pair.left.write(STEP)  # the server waits for the right arm's answer now, and shows nothing
    with pytest.raises(ConnectionLost, match="no state for"):
        pair.wait()


def test_waiting_tells_which_arm_can_be_read(pair: FciPair):
    pair.start()
    seen = 0
    while seen != 3:
        seen |= pair.wait()
    answer_both(pair, STEP)
    seen = 0
    while seen != 3:
        seen |= pair.wait()
    left, right = pair.left.read(), pair.right.read()
    assert left.t_ns == right.t_ns


def test_nobody_at_the_address():
    with pytest.raises(ConnectionLost, match=r"127\.0\.99\.99 does not answer") as caught:
        FciArm("127.0.99.99")
    assert "\n" not in str(caught.value)


def test_the_pad_is_told_once_and_another_tool_is_refused(served_arms: ServedArms):
    known = FciArm(served_arms.left, PAD)
    assert known.read().O_T_EE[2, 3] == pytest.approx(0.26, abs=1e-3)
    known.close()
    with pytest.raises(HardwareError, match=r"Desk has an end effector of 0\.350 kg, the tool weighs 0\.700 kg"):
        FciArm(served_arms.right, Pad((0.1, 0.1, 0.03), 0.70, 0.03))


def test_what_is_no_torque_is_refused_in_one_line_before_the_robot_starts(served_arms: ServedArms):
    with closing(FciArm(served_arms.left)) as arm:
        arm.read()
        for torque in (np.zeros(6), np.zeros((7, 1)), None, "0", [0.0] * 6 + [None]):
            with pytest.raises(ValueError, match=rf"{served_arms.left}: .* seven numbers.*found") as refused:
                arm.write(torque)
            assert "\n" not in str(refused.value)
            assert not arm.in_motion
        arm.write(np.zeros(7))  # the state still waits for an answer
        assert arm.in_motion


def test_an_end_effector_elsewhere_moves_the_pose(served_arms: ServedArms):
    pose = FciArm(served_arms.left, PAD)
    face = pose.read().O_T_EE.copy()
    pose.close()
    further = FciArm(served_arms.left, Pad((0.1, 0.1, 0.03), 0.35, 0.05))
    assert np.linalg.inv(face) @ further.read().O_T_EE == pytest.approx(
        np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.02], [0, 0, 0, 1]]), abs=1e-6
    )
    further.close()


@contextmanager
def deaf(setting: str, answer: str) -> Iterator[str]:
    """Serve a robot that accepts a setting and keeps another one; yields the left arm's address."""
    left, right = addresses()
    program = (
        "import sys; from sim_robot.fci.settings import Settings; from rtstack.cli.app import app\n"
        f"Settings.{setting} = {answer}\n"
        "app(['sim', '--lockstep', '--tracker', '', '--cpu', '-1', '--left', sys.argv[1], '--right', sys.argv[2]])"
    )
    command = [sys.executable, "-c", program, left, right]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert any(line.startswith("serving") for line in process.stdout or ())
            yield left
        finally:
            process.terminate()


FACE = Pad((0.1, 0.1, 0.03), 0.35, 0.05)  # elsewhere than the box has it: NE_T_EE is set


@pytest.mark.parametrize(
    ("setting", "answer", "said"),
    [
        ("set_frame", "lambda self, name, values: None", r"F_T_EE as .*0\.03.* it was set to .*0\.05"),
        ("set_load", "lambda self, values: self.record.__setitem__('m_load', 1.5)", "m_load as 1.5, it was set to 0"),
    ],
)
def test_a_robot_that_keeps_what_its_last_client_set_is_refused(setting: str, answer: str, said: str):
    with deaf(setting, answer) as address:
        with pytest.raises(HardwareError, match=rf"{address} reports {said}.*restart the control box") as refused:
            FciArm(address, FACE)
        assert "\n" not in str(refused.value)


def test_a_simulator_does_not_outlive_who_started_it():
    program = (
        "from rtstack.cells.simulator import Simulator; import os, signal\n"
        "s = Simulator('rice_box', 0.0, 0, lockstep=True); print(s.pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    ended = subprocess.run([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert ended.returncode == -9
    process = Path("/proc") / ended.stdout.strip()
    while process.exists() and "\nState:\tZ" not in (process / "status").read_text():
        pass


def test_a_simulator_that_cannot_start_says_why():
    with pytest.raises(HardwareError, match=r"the simulated robot did not start: .*anvil"):
        Simulator("anvil", 0.0, 0, lockstep=True)


def test_an_error_is_known_in_either_of_the_vendor_s_spellings() -> None:
    assert names_in("motion aborted by reflex! [tau_J_range_violation]") == ("tau_j_range_violation",)
    assert names_in('{"joint_reflex": true, nothing_of_the_kind}') == ("joint_reflex",)


def test_a_real_time_kernel_is_needed_where_that_is_asked_for():
    refused = pytest.raises(HardwareError, match=r"realtime capabilities. Run .*host-setup.*enforce_realtime = false")
    with serve("--lockstep") as served, nullcontext() if Path("/sys/kernel/realtime").exists() else refused:
        FciArm(served.left, enforce_realtime=True).close()


def test_a_simulated_robot_ends_when_asked_whatever_its_starter_blocks():
    """A campaign's workers block the signals that are for the campaign; what they start must not."""
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        simulator = Simulator("", 0.0, 0, lockstep=True)
        status = Path(f"/proc/{simulator.pid}/status").read_text()
        simulator.close()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
    assert "SigBlk:\t0000000000000000" in status
    assert simulator.returncode == 0  # it was not killed
