"""What goes on beside an operator: busy loops, and attacks on a stack from outside, each as a context."""

import contextlib
import random
import resource
import socket
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from io import BytesIO
from typing import Any
from urllib.parse import urlsplit

import httpx
import numpy as np
from mcap.writer import CompressionType, Writer

from hal.wire import ROBOT_STATE
from tests.support.console.stack import Stack, repeated
from tests.support.log.same_log import busy_loops

DATAGRAMS_S = 1000  # of all kinds, to each arm
DESCRIPTORS = 1024  # the usual soft limit
IDLE = 2500
SILENT = 300
BOMB_BYTES, BOMB_NAMES = 8 << 20, 300  # CHAOS D5: one attachment, named so often by the index
AHEAD = (1, 20, 1000, 3000, 200_000, 10**9, 2**31, 2**63, 2**64 - 1, 0, -1, -4000)
SIZES = (0, 1, 8, 1376, 1378, 9000, 60_000)


@contextlib.contextmanager
def forged_states(stack: Stack) -> Iterator[None]:
    """Send states of 20 kinds from a stranger's address to libfranka's sockets: other numbers, other sizes, noise."""
    robot = next(process for name, process in stack.members.items() if "robot" in name)
    ports = [each.laddr.port for each in robot.net_connections("udp4")]
    rng, number, record = random.Random(0), 0, np.zeros(1, ROBOT_STATE)
    with socket.socket(type=socket.SOCK_DGRAM) as stranger:

        def send() -> None:
            nonlocal number
            for _ in range(DATAGRAMS_S // 100):
                number += 1
                kind = number % (len(AHEAD) + len(SIZES) + 1)
                record["message_id"] = (rng.randrange(10**6) + AHEAD[kind % len(AHEAD)]) % 2**64
                data = record.tobytes()
                if kind >= len(AHEAD) + len(SIZES):
                    data = rng.randbytes(len(data))
                elif kind >= len(AHEAD):
                    data = data.ljust(60_000, b"\0")[: SIZES[kind - len(AHEAD)]]
                for port in ports:
                    stranger.sendto(data, ("127.0.0.1", port))

        with repeated(send, 0.01):
            yield


@contextlib.contextmanager
def idle_connections(stack: Stack) -> Iterator[None]:
    """Keep 2,500 connections open that say nothing, and open again what is closed; the console may have 1,024."""
    console, port = stack.members["console"], urlsplit(stack.base).port
    before = console.rlimit(resource.RLIMIT_NOFILE)
    console.rlimit(resource.RLIMIT_NOFILE, (DESCRIPTORS, before[1]))
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(8192, before[1]), before[1]))
    opened: list[socket.socket] = []

    def fill() -> None:
        while len(opened) >= IDLE:
            opened.pop(0).close()
        for _ in range(250):
            one = socket.socket()
            one.setblocking(False)
            one.connect_ex(("127.0.0.1", port))
            opened.append(one)

    try:
        with repeated(fill, 0.1):
            yield
    finally:
        console.rlimit(resource.RLIMIT_NOFILE, before)
        for one in opened:
            one.close()


@contextlib.contextmanager
def silent_peers(stack: Stack) -> Iterator[None]:
    """Keep 300 connections open that send half of a request, a letter at a time, or a handshake without its end."""
    port = urlsplit(stack.base).port
    with contextlib.ExitStack() as peers:
        opened = []

        def say() -> None:
            for k, one in enumerate(opened):
                with contextlib.suppress(OSError):
                    one.sendall(b"x")
                    continue
                opened[k] = begin(k)

        def begin(k: int) -> socket.socket:
            one = peers.enter_context(socket.socket())
            one.settimeout(1.0)
            with contextlib.suppress(OSError):
                one.connect(("127.0.0.1", port))
                upgrade = "Connection: Upgrade\r\nUpgrade: websocket\r\n" * (k % 2)
                one.sendall(f"GET /live HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n{upgrade}X-A: ".encode())
            return one

        opened += [begin(k) for k in range(SILENT)]
        with repeated(say, 1.0):
            yield


def bombs() -> dict[str, bytes]:
    """Return a log of 8 MB whose index names one attachment 300 times, and a cut one that unpacks to a million empty
    messages."""
    files = {}
    for name in ("attachment", "messages"):
        file = BytesIO()
        writer = Writer(file, chunk_size=60 << 20, compression=CompressionType.LZ4)
        writer.start("", "bomb")
        writer.add_metadata("trial", {"kind": "trial"})
        arm = writer.register_channel(
            "/left/arm", "protobuf", writer.register_schema("rtstack.ArmSample", "protobuf", b"")
        )
        if name == "attachment":
            writer.add_attachment(0, 0, "cell.toml", "application/toml", bytes(BOMB_BYTES))
            writer._Writer__attachment_indexes *= BOMB_NAMES  # type: ignore[attr-defined]
        for t_ns in range(1 if name == "attachment" else 1_000_000):
            writer.add_message(arm, t_ns, b"", t_ns)
        writer.finish()
        files[name] = file.getvalue() if name == "attachment" else file.getvalue()[:-100]
    return files


@contextlib.contextmanager
def bombs_listed(stack: Stack) -> Iterator[None]:
    """Put bombs into the folder of logs under new names, and have a viewer ask for the list and for each."""
    files, number = bombs(), 0
    with httpx.Client(base_url=stack.base, cookies=stack.client.cookies, trust_env=False, timeout=60.0) as viewer:

        def ask() -> None:
            nonlocal number
            number += 1
            for name, data in files.items():
                (stack.logs / f"bomb-{name}-{number}.mcap").write_bytes(data)
                (stack.logs / f"bomb-{name}-{number - 1}.mcap").unlink(missing_ok=True)
            for row in viewer.get("/api/logs").json():
                if "bomb" in row["name"]:
                    viewer.get(f"/api/logs/{row['id']}")

        with repeated(ask, 1.0):
            yield


@contextlib.contextmanager
def computing(_stack: Stack | None) -> Iterator[None]:
    """Two busy loops."""
    with busy_loops(2):
        yield


@contextlib.contextmanager
def nothing(_stack: Stack | None) -> Iterator[None]:
    """Nothing else than the operator."""
    yield


# those that need the console and the robot process of a stack are for ways at the page
BESIDE: dict[str, Callable[[Any], AbstractContextManager[None]]] = {
    "quiet": nothing, "busy": computing, "forged states": forged_states, "idle connections": idle_connections,
    "silent peers": silent_peers, "bombs": bombs_listed,
}  # fmt: skip
