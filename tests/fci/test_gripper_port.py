"""The grippers' ports, served by hand: what is refused, what ends how, and silent connections hold nobody up."""

import contextlib
import os
import socket
import struct
import time
from collections.abc import Callable, Iterator
from importlib.resources import files
from pathlib import Path

import pytest

from hal.wire import GRIPPER_HEADER, GRIPPER_PORT, GRIPPER_VERSION
from sim_robot.cell import SimulatedCell, simulated_cell
from sim_robot.fci.gripper import MOST_CLIENTS, NOT_MOUNTED, STATE, GripperPort
from sim_robot.fci.poller import Poller
from sim_robot.fci.protocol import VACUUM_PORT, VACUUM_VERSION

LATER_S = 30.0  # no test waits so long unless it fails
ADDRESS = f"127.19.{os.getpid() // 250 % 250}.{1 + os.getpid() % 250}"
CONNECT, HOMING, GRASP, MOVE, STOP = range(5)
SUCCESS, FAIL, UNSUCCESSFUL, ABORTED = range(4)
SCENE = Path(str(files("sim_robot") / "scenes" / "hand.toml"))


class Served:
    """A port whose poller and plant go on when the test says so."""

    def __init__(self, cell: SimulatedCell | None) -> None:
        self.poller, self.cell = Poller(), cell
        self.port = GripperPort(self.poller, ADDRESS, None if cell is None else cell.hands[0])

    def turn(self) -> None:
        self.poller.serve(1e-3)
        if self.cell is not None:
            self.cell.next_state()
        self.port.settle()
        self.port.show()

    def until(self, done: Callable[[], object]) -> None:
        ends = time.monotonic() + LATER_S
        while not done():
            assert time.monotonic() < ends
            self.turn()

    def close(self) -> None:
        self.port.close()
        self.poller.close()


class Client:
    """One TCP connection and a UDP socket, byte by byte."""

    def __init__(self, served: Served, port: int = GRIPPER_PORT) -> None:
        self._served, self._next_id = served, 0
        self.tcp = socket.create_connection((ADDRESS, port), timeout=LATER_S)
        self.tcp.setblocking(False)
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.bind(("", 0))
        self.udp.setblocking(False)
        self.received = b""

    def order(self, command: int, *values: float) -> int:
        """Send a command; return its id."""
        self._next_id += 1
        payload = struct.pack(f"<{len(values)}d", *values)
        self.tcp.sendall(GRIPPER_HEADER.pack(command, self._next_id, GRIPPER_HEADER.size + len(payload)) + payload)
        return self._next_id

    def _read(self, size: int) -> bool:
        with contextlib.suppress(BlockingIOError):
            chunk = self.tcp.recv(size - len(self.received))
            if not chunk:
                raise ConnectionError("the server hung up")
            self.received += chunk
        return len(self.received) == size

    def answer(self, size: int = GRIPPER_HEADER.size + 2) -> tuple[int, ...]:
        """Return command, id and status of the next answer, and what comes after them."""
        self._served.until(lambda: self._read(size))
        (command, number, length), rest = (
            GRIPPER_HEADER.unpack_from(self.received),
            self.received[GRIPPER_HEADER.size :],
        )
        self.received = b""
        assert length == size
        return command, number, *struct.unpack(f"<{len(rest) // 2}H", rest)

    def connect(self, version: int = GRIPPER_VERSION) -> tuple[int, ...]:
        """Say Connect; return status and version of the answer."""
        payload = struct.pack("<HH", version, self.udp.getsockname()[1])
        self.tcp.sendall(GRIPPER_HEADER.pack(CONNECT, 7, GRIPPER_HEADER.size + len(payload)) + payload)
        command, number, *answer = self.answer(GRIPPER_HEADER.size + 4)
        assert (command, number) == (CONNECT, 7)
        return tuple(answer)

    def hung_up(self) -> bool:
        try:
            return self.tcp.recv(1) == b""
        except BlockingIOError:
            return False
        except ConnectionResetError:
            return True

    def was_reset(self) -> bool:
        """True once the server has reset the connection: libfranka would wait for ever for one that merely ends."""
        try:
            assert self.tcp.recv(1) != b"", "the connection ended without a reset"
        except BlockingIOError:
            return False
        except ConnectionResetError:
            return True
        raise AssertionError("an answer instead of a reset")

    def sees(self, width: float, max_width: float = 0.08, is_grasped: bool = False) -> int:
        """Wait for a state of these widths, to the mm, and return its number; their numbers rise until then."""
        numbers = [0]

        def seen() -> bool:
            try:
                state = self.udp.recv(100)
            except BlockingIOError:
                return False
            assert len(state) == 23
            number, *widths, grasped, temperature = STATE.unpack(state)
            assert (number > numbers[-1], temperature) == (True, 25)
            numbers.append(number)
            return widths == pytest.approx([width, max_width], abs=1e-3) and bool(grasped) == is_grasped

        self._served.until(seen)
        return numbers[-1]

    def close(self) -> None:
        self.tcp.close()
        self.udp.close()


@pytest.fixture
def served() -> Iterator[Served]:
    """The port of a hand."""
    served = Served(simulated_cell("block", 0.0, seed=3, scene=SCENE))
    yield served
    served.close()


@pytest.fixture
def bare() -> Iterator[Served]:
    """The port of an arm without a hand."""
    served = Served(None)
    yield served
    served.close()


@pytest.fixture
def client(served: Served) -> Iterator[Client]:
    """A client that has said Connect, and homed the hand."""
    client = Client(served)
    assert client.connect() == (SUCCESS, GRIPPER_VERSION)
    number = client.order(HOMING)
    assert client.answer() == (HOMING, number, SUCCESS)
    yield client
    client.close()


def test_without_a_hand_connect_is_refused_and_every_time(bare: Served) -> None:
    for _ in range(2 * MOST_CLIENTS):
        with contextlib.closing(Client(bare)) as client:
            assert client.connect() == (NOT_MOUNTED, GRIPPER_VERSION)


def test_a_wrong_version_is_told_so(served: Served) -> None:
    with contextlib.closing(Client(served)) as client:
        assert client.connect(version=2) == (1, GRIPPER_VERSION)


def test_no_vacuum_gripper_is_mounted() -> None:
    served = Served(None)
    served.port.close()
    served.port = GripperPort(served.poller, ADDRESS, None, VACUUM_PORT, VACUUM_VERSION)
    with contextlib.closing(served), contextlib.closing(Client(served, VACUUM_PORT)) as client:
        assert client.connect(VACUUM_VERSION) == (NOT_MOUNTED, VACUUM_VERSION)


@pytest.mark.parametrize(
    "message",
    [
        GRIPPER_HEADER.pack(HOMING, 1, GRIPPER_HEADER.size),  # before Connect
        GRIPPER_HEADER.pack(MOVE, 1, 0xFFFFFFFF),
        GRIPPER_HEADER.pack(STOP, 1, 3),
        GRIPPER_HEADER.pack(77, 1, GRIPPER_HEADER.size),
        b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n",
    ],
)
def test_what_cannot_be_trusted_resets_the_connection(served: Served, message: bytes) -> None:
    with contextlib.closing(Client(served)) as client:
        client.tcp.sendall(message)
        served.until(client.was_reset)


def test_half_a_message_waits_for_its_other_half(served: Served, client: Client) -> None:
    whole = GRIPPER_HEADER.pack(STOP, 9, GRIPPER_HEADER.size)
    client.tcp.sendall(whole[:7])
    for _ in range(5):
        served.turn()
    client.tcp.sendall(whole[7:])
    assert client.answer() == (STOP, 9, SUCCESS)


def test_states_come_with_rising_numbers_and_show_the_hand(served: Served, client: Client) -> None:
    client.sees(0.08)
    number = client.order(GRASP, 0.05, 0.005, 0.005, 0.1, 30.0)  # width, both tolerances, speed, force
    assert client.answer() == (GRASP, number, SUCCESS)
    client.sees(0.05, is_grasped=True)
    client.order(STOP)
    client.answer()
    client.sees(0.051)


def test_every_status_of_a_command(served: Served, client: Client) -> None:
    assert client.order(MOVE, 0.07, 0.1)
    assert client.answer()[2] == SUCCESS
    client.order(MOVE, 0.09, 0.1)
    assert client.answer()[2] == FAIL
    client.order(GRASP, 0.02, 0.005, 0.005, 0.1, 30.0)
    assert client.answer()[2] == UNSUCCESSFUL
    client.order(MOVE, 0.08, 0.1)
    served.turn()
    client.order(STOP)
    assert [client.answer()[::2], client.answer()[::2]] == [(MOVE, ABORTED), (STOP, SUCCESS)]


def test_another_clients_command_aborts_the_one_that_runs(served: Served, client: Client) -> None:
    with contextlib.closing(Client(served)) as second:
        assert second.connect() == (SUCCESS, GRIPPER_VERSION)
        number = client.order(MOVE, 0.055, 0.02)
        served.until(lambda: served.cell is not None and served.cell.hands[0].busy)
        second.order(MOVE, 0.08, 0.1)
        assert client.answer() == (MOVE, number, ABORTED)
        assert second.answer()[2] == SUCCESS
        assert client.sees(0.08) <= second.sees(0.08)


def test_what_a_client_has_ordered_goes_on_after_it_has_gone(served: Served, client: Client) -> None:
    with contextlib.closing(Client(served)) as second:
        second.connect()
        second.order(MOVE, 0.06, 0.1)
        served.until(lambda: served.cell is not None and served.cell.hands[0].busy)
    served.until(lambda: served.cell is not None and not served.cell.hands[0].busy)
    client.sees(0.06)


def test_when_the_server_ends_who_waits_for_an_answer_is_told(served: Served, client: Client) -> None:
    client.order(MOVE, 0.055, 0.001)
    served.until(lambda: served.cell is not None and served.cell.hands[0].busy)
    served.port.close()
    assert client.was_reset()
    served.port = GripperPort(served.poller, ADDRESS, None)


def test_the_longest_silent_connection_makes_room(served: Served, client: Client) -> None:
    with contextlib.ExitStack() as stack:
        silent = [stack.enter_context(contextlib.closing(Client(served))) for _ in range(3 * MOST_CLIENTS)]
        late = stack.enter_context(contextlib.closing(Client(served)))
        assert late.connect() == (SUCCESS, GRIPPER_VERSION)
        assert silent[0].hung_up()
        assert not silent[-1].hung_up()
        assert not client.hung_up()  # nor does a crowd drive out who has said Connect
        assert not late.hung_up()


def test_where_all_have_said_connect_the_next_one_is_turned_away(served: Served) -> None:
    with contextlib.ExitStack() as stack:
        clients = [stack.enter_context(contextlib.closing(Client(served))) for _ in range(MOST_CLIENTS)]
        for client in clients:
            assert client.connect() == (SUCCESS, GRIPPER_VERSION)
        late = stack.enter_context(contextlib.closing(Client(served)))
        served.until(late.was_reset)
        assert not any(client.hung_up() for client in clients)
