"""The gripper's port, served by hand: silent connections hold nobody up."""

import contextlib
import os
import socket
import struct
import time
from collections.abc import Callable, Iterator

import pytest

from sim_robot.fci.gripper import MOST_CLIENTS, Gripper
from sim_robot.fci.poller import Poller
from sim_robot.fci.protocol import GRIPPER_HEADER, GRIPPER_PORT, GRIPPER_VERSION

LATER_S = 30.0  # no test waits so long unless it fails
ADDRESS = f"127.19.{os.getpid() // 250 % 250}.{1 + os.getpid() % 250}"


@pytest.fixture
def poller() -> Iterator[Poller]:
    """A gripper's port whose poller turns when the test says so."""
    poller = Poller()
    gripper = Gripper(poller, ADDRESS)
    yield poller
    gripper.close()
    poller.close()


def until(poller: Poller, done: Callable[[], object]) -> None:
    ends = time.monotonic() + LATER_S
    while not done():
        assert time.monotonic() < ends
        poller.serve(1e-3)


def connection(stack: contextlib.ExitStack) -> socket.socket:
    return stack.enter_context(socket.create_connection((ADDRESS, GRIPPER_PORT), timeout=LATER_S))


def connected(stack: contextlib.ExitStack, poller: Poller) -> socket.socket:
    """A client that has said Connect and was answered."""
    tcp = connection(stack)
    tcp.sendall(GRIPPER_HEADER.pack(0, 1, GRIPPER_HEADER.size + 4) + struct.pack("<HH", GRIPPER_VERSION, 4000))
    answer = GRIPPER_HEADER.size + 4
    tcp.setblocking(False)

    def answered() -> bool:
        try:
            return len(tcp.recv(answer, socket.MSG_PEEK)) == answer
        except BlockingIOError:
            return False

    until(poller, answered)
    assert tcp.recv(answer)[GRIPPER_HEADER.size :] == struct.pack("<HH", 0, GRIPPER_VERSION)
    return tcp


def hung_up(tcp: socket.socket) -> bool:
    tcp.setblocking(False)
    try:
        return tcp.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True


def test_the_longest_silent_connection_makes_room(poller: Poller) -> None:
    with contextlib.ExitStack() as stack:
        client = connected(stack, poller)
        silent = [connection(stack) for _ in range(3 * MOST_CLIENTS)]
        late = connected(stack, poller)
        assert hung_up(silent[0])
        assert not hung_up(silent[-1])
        assert not hung_up(client)  # nor does a crowd drive out who has said Connect
        assert not hung_up(late)


def test_where_all_have_said_connect_the_next_one_is_turned_away(poller: Poller) -> None:
    with contextlib.ExitStack() as stack:
        clients = [connected(stack, poller) for _ in range(MOST_CLIENTS)]
        late = connection(stack)
        until(poller, lambda: hung_up(late))
        assert not any(map(hung_up, clients))
