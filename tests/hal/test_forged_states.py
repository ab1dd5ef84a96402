"""Datagrams that are no state of the robot, or not its next one, on libfranka's socket."""

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from hal.errors import ConnectionLost
from hal.fci import FciArm, ask_for_urdf, call_limit, open_pair
from hal.fci.peeked_state import AHEAD_MS, DROPPED, JUMPED, OLDEST, PeekedState, stamp_arrivals
from hal.wire import ROBOT_STATE
from rtstack.cli.recovery import recover_arms
from tests.support.fci.server import addresses

BOX = Path(__file__).parents[1] / "support" / "fci" / "bad_box.py"
FORGED = [AHEAD_MS + 1000, 3_000, 200_000, 2**31, 2**63 - 5000, 2**63, 2**64 - 1 - 5000, 0, -1, -4000]


def state(number: int) -> bytes:
    record = np.zeros(1, ROBOT_STATE)
    record["message_id"] = number % 2**64
    return record.tobytes()


@pytest.fixture
def wire():
    """A robot's socket and ours, of which the kernel stamps what arrives."""
    with socket.socket(type=socket.SOCK_DGRAM) as robot, socket.socket(type=socket.SOCK_DGRAM) as ours:
        ours.bind(("127.0.0.1", 0))
        robot.connect(ours.getsockname())
        stamp_arrivals(ours.fileno())
        yield robot, ours


def read(robot: socket.socket, ours: socket.socket, peeked: PeekedState, number: int) -> int:
    robot.send(state(number))
    assert peeked.look(ours.fileno())
    assert int(peeked.words[OLDEST]) == number
    ours.recv(2000)
    return peeked.take(number)


def test_what_does_not_follow_is_dropped_before_the_next_state(wire):
    robot, ours = wire
    peeked = PeekedState()
    assert read(robot, ours, peeked, 5000) == 0
    for ahead in FORGED:
        robot.send(state(5000 + ahead))
    for size in (0, 1, 8, 1376, 1378, 20_000):
        robot.send(state(5001).ljust(20_000, b"\0")[:size])
    assert not peeked.look(ours.fileno())
    assert int(peeked.words[DROPPED]) == len(FORGED) + 6
    for number in (5001, 5002, 5010):
        assert read(robot, ours, peeked, number) == 0
    assert "sent 16 datagrams that do not follow state 5010" in peeked.strange


def test_a_state_between_the_look_and_the_read_is_noticed(wire):
    robot, ours = wire
    for ahead in FORGED[:4]:
        peeked = PeekedState()
        assert read(robot, ours, peeked, 5000) == 0
        assert peeked.take(5000 + ahead) == JUMPED


def test_a_number_may_go_on_as_far_as_time_has(wire):
    robot, ours = wire
    peeked = PeekedState()
    assert read(robot, ours, peeked, 5000) == 0
    time.sleep(0.4)
    assert read(robot, ours, peeked, 5400) == 0
    for number in range(5401, 5480):  # nothing was read for a while: libfranka takes the newest
        robot.send(state(number))
    assert peeked.look(ours.fileno())
    assert peeked.take(5479) == -1


@pytest.mark.alone  # neither side may be kept waiting for as long as a robot that is lost
def test_strangers_are_not_heard_and_a_box_that_counts_anew_is_lost():
    left, right = addresses()
    program = (
        "import signal, sys; from sim_robot.fci.link import Link; from rtstack.cli.app import app\n"
        "send, asked = Link._send_state, []\n"
        "signal.signal(signal.SIGUSR1, lambda number, frame: asked.append(number))\n"
        "def later(self, data):\n"
        "    back = 100_000 if asked else 0\n"
        "    number = int.from_bytes(data[:8], 'little') + 100_000 - back\n"
        "    send(self, number.to_bytes(8, 'little') + bytes(data[8:]))\n"
        "Link._send_state = later\n"
        "app(['sim', '--slower', '8', '--tracker', '', '--cpu', '-1', '--left', sys.argv[1], '--right', sys.argv[2]])"
    )
    command = [sys.executable, "-c", program, left, right]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert any(line.startswith("serving") for line in process.stdout or ())
            with closing(open_pair(left, right)) as pair, socket.socket(type=socket.SOCK_DGRAM) as stranger:
                assert pair.left is not None
                with socket.socket(fileno=os.dup(pair.left.socket)) as ours:
                    port = ours.getsockname()[1]
                numbers: list[int] = []

                def go_on() -> None:
                    while True:
                        if len(numbers) < 100:
                            stranger.sendto(state(numbers[-1] + 200_000 if numbers else 10**9), ("127.0.0.1", port))
                        mask = pair.wait()
                        for side, arm in pair.arms.items():
                            if mask & side:
                                arm.read()
                        if mask & 1:
                            numbers.append(pair.arms[1].t_ns // 1_000_000)
                        if len(numbers) == 150:
                            process.send_signal(signal.SIGUSR1)

                with pytest.raises(ConnectionLost, match=r"has sent no state for 100 ms; it sent .* do not follow"):
                    go_on()
                assert len(numbers) > 100
                assert max(np.diff(numbers)) < 100
        finally:
            process.terminate()


@pytest.fixture(scope="module", params=["silent", "other", "garbage", "slow", "gone", "stateless"])
def box(request):
    """A box that accepts a connection and does not go on as a robot does: its address."""
    address, _ = addresses()
    with subprocess.Popen([sys.executable, str(BOX), address, request.param], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield address
        process.terminate()


def test_an_answer_of_4_gb_is_not_awaited():
    address, _ = addresses()
    with subprocess.Popen([sys.executable, str(BOX), address, "huge"], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        for ask in (lambda: ask_for_urdf(address), lambda: recover_arms(f"fci:{address}")):
            with pytest.raises(ConnectionLost, match="what answers there is no robot"):
                ask()
        process.terminate()


def test_a_box_that_is_no_robot_is_asked_no_longer_than_its_time(box, monkeypatch):
    monkeypatch.setattr(call_limit, "CALL_S", 1.5)
    monkeypatch.setattr("hal.fci.own_limits.PATIENCE_S", 0.3)
    with pytest.raises(ConnectionLost, match=f"{box} does not answer: .*FCI mode in Desk") as refused:
        ask_for_urdf(box)
    assert "\n" not in str(refused.value)
    with pytest.raises(ConnectionLost, match=f"{box} does not answer: .*FCI mode in Desk"):
        FciArm(box)
