"""One arm's sockets, served by hand: floods of connections, and who has the arm."""

import contextlib
import os
import socket
import struct
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from hal.wire import HEADER, PORT
from sim_robot.fci.link import MOST_SESSIONS, Link
from sim_robot.fci.poller import Poller
from sim_robot.fci.port import ACCEPT_PERIOD_S
from sim_robot.fci.protocol import Command, ConnectStatus
from tests.support.fci.client import connect as connect_client
from tests.support.fci.client import hold, torque_control
from tests.support.fci.raw import RawClient
from tests.support.fci.server import Served

FLOOD = 3000
LATER_S = 30.0  # no test waits so long unless it fails


class ServedByHand:
    """A link whose poller turns when the test says so."""

    def __init__(self) -> None:
        self.address = f"127.1.{os.getpid() // 250 % 250}.{1 + os.getpid() % 250}"
        self.poller = Poller()
        self.requests: list[Command] = []
        self.link = Link(self.poller, self.address, self._note, lambda command: None, lambda: None)

    def _note(self, command: Command, command_id: int, values: tuple) -> None:
        self.requests.append(command)

    def until(self, done: Callable[[], object]) -> None:
        """Turn until `done()`."""
        ends = time.monotonic() + LATER_S
        while not done():
            assert time.monotonic() < ends
            self.poller.serve(1e-3)


@pytest.fixture
def served() -> Iterator[ServedByHand]:
    """A link at an address of its own."""
    served = ServedByHand()
    yield served
    served.link.close()
    served.poller.close()


def said_connect(served: ServedByHand) -> socket.socket:
    """A new connection that has said Connect."""
    tcp = socket.create_connection((served.address, PORT), timeout=LATER_S)
    tcp.sendall(HEADER.pack(Command.CONNECT, 1, HEADER.size + 4) + struct.pack("<HH", 10, 4000))
    return tcp


def answered(tcp: socket.socket) -> int:
    """The status of the answer to Connect."""
    return tcp.recv(HEADER.size + 3)[HEADER.size]


def test_states_of_a_late_link_come_later_and_in_their_order(served: ServedByHand) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
        ours.bind(("127.0.0.1", 0))
        ours.setblocking(False)
        tcp = socket.create_connection((served.address, PORT), timeout=LATER_S)
        tcp.sendall(HEADER.pack(Command.CONNECT, 1, HEADER.size + 4) + struct.pack("<HH", 10, ours.getsockname()[1]))
        served.until(lambda: served.link.client is not None)
        served.link.be_late((5e3, 5e3, 2e4, 2e4), (1, 2))
        for number in range(50):
            served.link.send_state(memoryview(bytes([number])))
        with pytest.raises(BlockingIOError):
            ours.recv(8)
        came = bytearray()

        def read() -> bool:
            with contextlib.suppress(BlockingIOError):
                while True:
                    came.extend(ours.recv(8))
            return len(came) == 50

        served.until(read)
        assert came == bytes(range(50))
        tcp.close()


def test_a_flood_costs_the_loop_no_more_than_its_share(served: ServedByHand) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(100):
            stack.enter_context(socket.create_connection((served.address, PORT), timeout=LATER_S))
        began = time.monotonic()
        for _ in range(40):
            served.poller.serve(0.0)
        taken = served.link.refused + MOST_SESSIONS if served.link.refused else 0
        assert taken <= 1 + (time.monotonic() - began) / ACCEPT_PERIOD_S


def test_who_comes_after_silent_connections_is_served(served: ServedByHand) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(3 * MOST_SESSIONS):
            stack.enter_context(socket.create_connection((served.address, PORT), timeout=LATER_S))
        client = stack.enter_context(said_connect(served))
        served.until(lambda: served.link.client)
        assert answered(client) == ConnectStatus.SUCCESS
        for _ in range(3 * MOST_SESSIONS):
            stack.enter_context(socket.create_connection((served.address, PORT), timeout=LATER_S))
        served.until(lambda: served.link.refused >= 4 * MOST_SESSIONS)
        assert served.link.client is not None  # a crowd does not take the arm from who has it


def test_a_client_that_said_something_and_hung_up_makes_room_at_once(served: ServedByHand) -> None:
    """Its last words, its end and the next one's Connect all wait to be read, the newest first."""
    with contextlib.ExitStack() as stack:
        silent = stack.enter_context(socket.create_connection((served.address, PORT), timeout=LATER_S))
        served.until(lambda: len(served.poller._callbacks) == 2)
        first = said_connect(served)
        served.until(lambda: served.link.client)
        silent.close()  # leaves a lower descriptor to the next one
        served.until(lambda: len(served.poller._callbacks) == 3)
        second = stack.enter_context(socket.create_connection((served.address, PORT), timeout=LATER_S))
        served.until(lambda: len(served.poller._callbacks) == 4)
        first.sendall(HEADER.pack(Command.STOP_MOVE, 2, HEADER.size))
        first.close()
        second.sendall(HEADER.pack(Command.CONNECT, 1, HEADER.size + 4) + struct.pack("<HH", 10, 4000))
        served.until(lambda: served.requests)
        served.until(lambda: served.link.client)
        assert answered(second) == ConnectStatus.SUCCESS


def test_a_flood_on_one_arm_leaves_the_other_one_in_control(lockstep: Served) -> None:
    other = connect_client(lockstep.right)
    q_hold = np.array(other.read_once().q)
    opened: list[socket.socket] = []

    def law(tick: int, state) -> np.ndarray:
        for _ in range(FLOOD // 300):
            tcp = socket.socket()
            tcp.setblocking(False)
            tcp.connect_ex((lockstep.left, PORT))
            opened.append(tcp)
            if len(opened) > 200:  # some stay open, silent
                opened.pop(0).close()
        return hold(state, q_hold)

    try:
        states = torque_control(other, 300, law)
        steps = np.diff([round(1e3 * state.time.to_sec()) for state in states])
        assert np.array_equal(steps[2:], np.ones(297))
        assert states[-1].control_command_success_rate == 1.0
        with RawClient(lockstep.left) as raw:  # the flooded arm, too, is there for who says Connect
            assert raw.connect()[0] == ConnectStatus.SUCCESS
    finally:
        for tcp in opened:
            tcp.close()
