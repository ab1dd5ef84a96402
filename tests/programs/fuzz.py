"""Throws mutated messages at a server and looks whether it lives, keeps its clock, leaks nothing and serves afterwards.

`python -m tests.programs.fuzz --messages 1000000 --seed 0`. The server is a process of its own on loopback addresses of
its own. What is thrown depends on the seed alone; bounded by --messages and --seconds.

Takes half an hour, or --seconds.
"""

import random
import socket
import struct
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from hal.wire import GRIPPER_HEADER, GRIPPER_PORT, HEADER, PORT, ROBOT_COMMAND
from sim_robot.fci.protocol import PAYLOADS, Command, MoveStatus
from tests.programs import program
from tests.support.fci.client import connect, hold, torque_control
from tests.support.fci.raw import RawClient
from tests.support.fci.server import Served, serve

WARM_UP = 0.05  # share of the messages before memory counts: buffers and caches fill
BURST = 32  # datagrams between two states, so that the kernel's queue holds them all
WORST_RSS_GROWTH_KIB = 8192
SPECIAL = (float("nan"), float("inf"), -1e308, 5e-324, 0.0, 1e3)
LINGER = struct.pack("ii", 1, 0)  # close with a reset


@dataclass(slots=True)
class Outcome:
    """What was thrown and what the server's process looked like. ids: states per arm since the start."""

    messages: Counter = field(default_factory=Counter)
    connections: int = 0
    closed_by_server: int = 0
    answers: int = 0
    motions: int = 0
    lost_datagrams: int = 0  # which the kernel had no room for
    seconds: float = 0.0
    rss_kib: tuple[int, int] = (0, 0)
    descriptors: tuple[int, int] = (0, 0)
    ids: tuple[int, int] = (0, 0)
    alive: bool = False

    @property
    def total(self) -> int:
        """All messages."""
        return sum(self.messages.values())


def _rss_kib(process_id: int) -> int:
    for line in Path(f"/proc/{process_id}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1])
    raise RuntimeError("no VmRSS")


def _descriptors(process_id: int) -> int:
    return len(list(Path(f"/proc/{process_id}/fd").iterdir()))


def _random_payload(rng: random.Random, layout: struct.Struct) -> bytes:
    data = bytearray(rng.randbytes(layout.size) if rng.random() < 0.5 else bytes(layout.size))
    if layout.size >= 8 and rng.random() < 0.5:
        struct.pack_into("<d", data, rng.randrange(layout.size - 7), rng.choice(SPECIAL))
    return bytes(data)


def _flip(rng: random.Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        if changed:
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _request(rng: random.Random, command_id: int) -> tuple[str, bytes]:
    """One request, mutated or with nonsense inside a right frame."""
    command = rng.choice(list(Command)[1:])
    payload = _random_payload(rng, PAYLOADS[command])
    if command == Command.MOVE and rng.random() < 0.7:
        payload = struct.pack("<II", rng.randrange(4), rng.randrange(6)) + payload[8:104] + b"\0" + payload[105:]
    whole = HEADER.pack(command, command_id, HEADER.size + len(payload)) + payload
    draw = rng.random()
    if draw < 0.90:
        return "tcp nonsense values", whole
    if draw < 0.93:
        return "tcp bit flips", _flip(rng, whole)
    if draw < 0.95:
        return "tcp truncated", whole[: rng.randrange(1, len(whole))]
    if draw < 0.97:
        return "tcp wrong size", HEADER.pack(command, command_id, rng.randrange(600)) + payload
    if draw < 0.98:
        return "tcp oversize", HEADER.pack(command, command_id, rng.choice((0xFFFFFFFF, 1 << 31, 1 << 20))) + payload
    return "tcp garbage", rng.randbytes(rng.randrange(1, 600))


def _datagram(rng: random.Random, message_id: int) -> tuple[str, bytes]:
    """One command datagram, mutated, out of order, or with nonsense values."""
    record = np.zeros(1, ROBOT_COMMAND)
    record["message_id"] = message_id
    draw = rng.random()
    if draw < 0.3:
        record["message_id"] = (message_id + rng.choice((-1000, -2, -1, 1, 2, 1 << 40))) % (1 << 64)
        return "udp out of order", record.tobytes()
    if draw < 0.5:
        return "udp bit flips", _flip(rng, record.tobytes())
    if draw < 0.6:
        return "udp truncated", record.tobytes()[: rng.randrange(ROBOT_COMMAND.itemsize)]
    if draw < 0.7:
        return "udp oversize", record.tobytes() + rng.randbytes(rng.randrange(1, 2000))
    if draw < 0.8:
        return "udp garbage", rng.randbytes(ROBOT_COMMAND.itemsize)
    name = rng.choice(("q_c", "dq_c", "O_T_EE_c", "O_dP_EE_c", "elbow_c", "tau_J_d"))
    record[name] = rng.choice(SPECIAL)
    return "udp nonsense values", record.tobytes()


class Fuzzer:
    """One thrower of messages. Every wait in it is bounded."""

    def __init__(self, served: Served, seed: int) -> None:
        self._rng, self._served = random.Random(seed), served
        self.outcome = Outcome()
        self._attacks: tuple[Callable[[str], None], ...] = (
            self._requests, self._requests, self._commands, self._commands, self._before_connect, self._crowd,
            self._gripper,
        )  # fmt: skip

    def attack(self) -> None:
        """One session of some kind with one arm."""
        rng = self._rng
        try:
            rng.choice(self._attacks)(rng.choice((self._served.left, self._served.right)))
        except TimeoutError:
            raise  # the server hangs
        except OSError:  # reset, broken pipe, or not connected any more
            self.outcome.closed_by_server += 1

    def _client(self, address: str) -> RawClient:
        self.outcome.connections += 1
        return RawClient(address)

    def _drain(self, tcp: socket.socket) -> None:
        """Read what was answered so far."""
        tcp.setblocking(False)
        try:
            while True:
                chunk = tcp.recv(1 << 16)
                if not chunk:
                    raise ConnectionResetError("closed by the server")
                self.outcome.answers += 1
        except BlockingIOError:
            pass
        finally:
            tcp.settimeout(5.0)

    def _requests(self, address: str) -> None:
        """A client that says Connect and then sends requests until it is thrown out."""
        rng = self._rng
        with self._client(address) as raw:
            raw.connect()
            for number in range(rng.randrange(1, 200)):
                kind, data = _request(rng, number)
                self.outcome.messages[kind] += 1
                if rng.random() < 0.1:
                    cut = rng.randrange(len(data))
                    raw.tcp.sendall(data[:cut])
                    raw.tcp.sendall(data[cut:])
                else:
                    raw.tcp.sendall(data)
                self._drain(raw.tcp)
                if kind != "tcp nonsense values":
                    break
            self._hang_up(raw.tcp)

    def _hang_up(self, tcp: socket.socket) -> None:
        """Say that nothing follows and wait until the server has read it all: closing at once would throw it away."""
        tcp.shutdown(socket.SHUT_WR)
        tcp.settimeout(5.0)
        while tcp.recv(1 << 16):
            self.outcome.answers += 1

    def _commands(self, address: str) -> None:
        """A client that moves the arm, if it can, and sends datagrams; sometimes it hangs up in the middle."""
        rng = self._rng
        with self._client(address) as raw:
            raw.connect()
            controller = rng.randrange(3)
            generator = 4 if controller == 2 else rng.randrange(4)
            # others have set thresholds of zero, with which no arm recovers or moves
            raw.send(Command.SET_COLLISION_BEHAVIOR, struct.pack("<52d", *[100.0] * 52))
            raw.answer()
            for _ in range(rng.randrange(1, 20)):
                raw.send(Command.AUTOMATIC_ERROR_RECOVERY)
                raw.answer()
                started = raw.move(controller, generator) == MoveStatus.MOTION_STARTED
                self.outcome.motions += started
                for _ in range(rng.randrange(1, 4)):
                    self._burst(raw)
                if started:
                    raw.send(Command.STOP_MOVE)  # two answers: of the motion, by whatever it ended, and of the stop
                    raw.answer()
                    raw.answer()
            self._burst(raw)
            self.outcome.lost_datagrams += raw.lost_on_the_way()

    def _burst(self, raw: RawClient) -> None:
        state = raw.state()
        for _ in range(BURST):
            kind, data = _datagram(self._rng, int(state["message_id"]))
            self.outcome.messages[kind] += 1
            raw.throw(data)

    def _before_connect(self, address: str) -> None:
        """Anything but Connect as the first message."""
        kind, data = _request(self._rng, 1)
        self.outcome.messages["before connect: " + kind.split()[1]] += 1
        with self._client(address) as raw:
            raw.tcp.sendall(data)

    def _crowd(self, address: str) -> None:
        """Many connections at once with half messages, closed in no order, by FIN or by reset."""
        rng, crowd = self._rng, []
        for _ in range(rng.randrange(2, 16)):
            tcp = socket.create_connection((address, PORT), timeout=5.0)
            self.outcome.connections += 1
            crowd.append(tcp)
            half = HEADER.pack(Command.CONNECT, 1, HEADER.size + 4)[: rng.randrange(HEADER.size)]
            try:
                tcp.sendall(half)
            except ConnectionError:
                self.outcome.closed_by_server += 1
            self.outcome.messages["half message"] += 1
        rng.shuffle(crowd)
        for tcp in crowd:
            if rng.random() < 0.5:
                tcp.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER)
            tcp.close()

    def _gripper(self, address: str) -> None:
        """The gripper's port, with and without Connect."""
        rng = self._rng
        with socket.create_connection((address, GRIPPER_PORT), timeout=5.0) as tcp:
            self.outcome.connections += 1
            if rng.random() < 0.7:
                tcp.sendall(GRIPPER_HEADER.pack(0, 1, GRIPPER_HEADER.size + 4) + struct.pack("<HH", 3, 4000))
            for number in range(rng.randrange(1, 20)):
                size = rng.choice((0, 16, 40))
                data = GRIPPER_HEADER.pack(rng.randrange(5), number, GRIPPER_HEADER.size + size) + rng.randbytes(size)
                tcp.sendall(_flip(rng, data) if rng.random() < 0.2 else data)
                self.outcome.messages["gripper"] += 1
                self._drain(tcp)


def _newest_id(address: str) -> int:
    """Return the arm's message id, once the last attacker's connection has gone."""
    for _ in range(100):
        with RawClient(address) as raw:
            if raw.connect()[0] == 0:
                return int(raw.state()["message_id"])
    raise RuntimeError("the arm stays taken")


def _serves(served: Served) -> bool:
    """A real client recovers each arm, controls it and leaves it idle."""
    for address in (served.left, served.right):
        robot = connect(address)
        # requests that were in order have been carried out: thresholds of zero, which refuse a recovery, or a load that
        # is not there
        robot.set_collision_behavior([20.0] * 7, [100.0] * 7, [20.0] * 6, [250.0] * 6)
        robot.set_load(0.0, [0.0] * 3, [0.0] * 9)
        for set_frame in (robot.set_EE, robot.set_K):
            set_frame([float(number % 5 == 0) for number in range(16)])
        robot.automatic_error_recovery()
        q_hold = np.array(robot.read_once().q)
        torque_control(robot, 50, lambda tick, state, q_hold=q_hold: hold(state, q_hold))
    return True


def fuzz(served: Served, messages: int, seed: int, seconds: float) -> Outcome:
    """Throw until `messages` or `seconds` are reached. Raises what the check with the real client raises."""
    fuzzer, number = Fuzzer(served, seed), served.pid
    outcome = fuzzer.outcome
    addresses = (served.left, served.right)
    before_ids = [_newest_id(address) for address in addresses]
    before_descriptors, before_rss = _descriptors(number), 0
    began = time.monotonic()
    while outcome.total < messages and time.monotonic() - began < seconds:
        fuzzer.attack()
        if not before_rss and outcome.total >= WARM_UP * messages:
            before_rss = _rss_kib(number)
    after_ids = [_newest_id(address) for address in addresses]
    outcome.seconds = time.monotonic() - began
    outcome.ids = (after_ids[0] - before_ids[0], after_ids[1] - before_ids[1])
    outcome.alive = served.alive and _serves(served)
    for address in addresses:  # what the real client left is gone when the next one is let in
        _newest_id(address)
    outcome.rss_kib, outcome.descriptors = (before_rss, _rss_kib(number)), (before_descriptors, _descriptors(number))
    return outcome


def leaks(outcome: Outcome) -> bool:
    """True when memory or descriptors grew by more than what the last, closing client may hold."""
    rss, descriptors = outcome.rss_kib, outcome.descriptors
    return rss[1] - rss[0] > WORST_RSS_GROWTH_KIB or descriptors[1] - descriptors[0] > 2


def main(
    messages: int = 1_000_000,
    seconds: float = 1800.0,
    seed: int = 0,
    lockstep: Annotated[bool, typer.Option("--lockstep", help="the server that waits for answers")] = False,
) -> int:
    """Print a table. Returns 0, or 1 when the server failed in any way."""
    with serve(*["--lockstep"] * lockstep) as served:
        outcome = fuzz(served, messages, seed, seconds)
    for kind, count in sorted(outcome.messages.items()):
        print(f"{kind:32} {count:9d}")
    print(f"{'messages':32} {outcome.total:9d}  in {outcome.seconds:.0f} s, seed {seed}")
    print(f"{'connections':32} {outcome.connections:9d}  {outcome.closed_by_server} closed by the server")
    print(f"{'reads with answers':32} {outcome.answers:9d}")
    print(f"{'motions begun':32} {outcome.motions:9d}")
    print(f"{'datagrams the kernel dropped':32} {outcome.lost_datagrams:9d}")
    print(f"{'ms of each arm per s':32} {' '.join(f'{ids / outcome.seconds:9.1f}' for ids in outcome.ids)}")
    print(f"{'memory, KiB, before and after':32} {outcome.rss_kib[0]:9d} {outcome.rss_kib[1]:9d}")
    print(f"{'descriptors, before and after':32} {outcome.descriptors[0]:9d} {outcome.descriptors[1]:9d}")
    print(f"{'a real client is served':32} {outcome.alive!s:>9}")
    return 0 if outcome.alive and not leaks(outcome) and min(outcome.ids) > 0 else 1


if __name__ == "__main__":
    program(main)
