"""What answers as a Desk, and sends what no box sends: one line, in a bounded time and memory."""

import gzip
import json
import socket
import ssl
import threading
import time
import tracemalloc
from collections.abc import Callable
from contextlib import closing, suppress

import psutil
import pytest

from hal.desk import Desk, DeskError, Trust, client
from hal.desk.state import state_of
from sim_robot.desk.server import server_context

HEAD = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\n"


def whole(body: bytes, *headers: bytes) -> bytes:
    return HEAD + b"".join(header + b"\r\n" for header in headers) + b"Content-Length: %d\r\n\r\n" % len(body) + body


def endless(line: socket.socket) -> None:
    line.sendall(HEAD + b"Transfer-Encoding: chunked\r\n\r\n")
    for _ in range(1500):
        line.sendall(b"100000\r\n" + bytes(1 << 20) + b"\r\n")


def slowly(line: socket.socket) -> None:
    for byte in whole(b"{}"):
        line.sendall(bytes([byte]))
        time.sleep(0.05)


def slow_body(line: socket.socket) -> None:
    line.sendall(HEAD + b"Content-Length: 1000\r\n\r\n")
    for _ in range(1000):
        line.sendall(b" ")
        time.sleep(0.05)


BOMB = whole(gzip.compress(bytes(64 << 20)), b"Content-Encoding: gzip")


@pytest.fixture
def server(tmp_path):
    """A server that does one thing with each connection, and the trust in it."""
    act: list[Callable[[socket.socket], None]] = []
    listener = socket.create_server(("127.0.0.1", 0))
    address = f"127.0.0.1:{listener.getsockname()[1]}"
    context = server_context("127.0.0.1")

    def serve() -> None:
        while True:
            try:
                raw, _ = listener.accept()
            except OSError:  # the test is over
                return
            with suppress(OSError), raw, context.wrap_socket(raw, server_side=True) as line:
                line.recv(65536)
                act[0](line)

    threading.Thread(target=serve, daemon=True).start()
    trust = Trust(tmp_path)
    act.append(lambda line: None)
    trust.remember(address)
    yield address, trust, act
    listener.shutdown(socket.SHUT_RDWR)
    listener.close()


@pytest.fixture
def desk(server):
    """Return the error of a client of such a server."""
    address, trust, act = server

    def ask(what: Callable[[socket.socket], None]) -> DeskError:
        act[:] = [what]
        with closing(Desk(address, trust)) as box, pytest.raises(DeskError) as refused:
            box.state()
        assert "\n" not in str(refused.value)
        assert str(refused.value).isprintable()
        return refused.value

    return ask


def test_a_box_that_hangs_up_after_each_answer_costs_one_socket(server):
    address, trust, act = server
    act[:] = [lambda line: line.sendall(whole(b"{}"))]
    with closing(Desk(address, trust)) as box:
        for _ in range(5):
            assert box.state().status == "unknown"
        port = int(address.partition(":")[2])
        ours = [one for one in psutil.Process().net_connections("tcp4") if one.raddr and one.raddr[1] == port]
        assert len(ours) <= 2  # httpx's, and the one to hang up on it


@pytest.mark.parametrize("answer", [endless, lambda line: line.sendall(BOMB)])
def test_a_long_body_is_refused_and_kept_nowhere(desk, answer):
    tracemalloc.start()
    assert "longer than 1048576 bytes" in str(desk(answer))
    assert tracemalloc.get_traced_memory()[1] < 32 << 20
    tracemalloc.stop()


@pytest.mark.parametrize("answer", [slowly, slow_body])
def test_a_byte_now_and_then_ends_in_time(desk, answer, monkeypatch):
    monkeypatch.setattr(client, "_ANSWER_S", 0.5)
    assert "does not answer" in str(desk(answer))


def test_control_characters_reach_no_terminal(desk):
    said = {"code": "\x1b[2J", "message": "\x1b]0;x\x07 no \u202e", "details": ["\x9b31m", 7]}
    body = json.dumps(said).encode()
    error = desk(lambda line: line.sendall(whole(body).replace(b"200 OK", b"409 No", 1)))
    assert "refuses ([2J" not in str(error)
    assert "31m, 7: ]0;x no" in str(error)


def test_deep_json_and_numbers_out_of_range_are_unknown(desk):
    desk(lambda line: line.sendall(whole(b"[" * 500_000).replace(b"200 OK", b"409 No", 1)))
    for left in (10**4000, float("nan"), float("inf")):
        assert state_of(None, None, None, None, {"remaining": left}, None, "1\x1b\n2").self_test_s is None
    assert state_of({"status": "a\x1b[1m\r\nb"}, None, None, None, None, None, "5\x1b.9\n2").version == "5 .9"


def test_a_certificate_that_is_not_shown_in_time_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(client, "_TIMEOUT_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as listener, pytest.raises((OSError, ssl.SSLError)):
        Trust(tmp_path).remember(f"127.0.0.1:{listener.getsockname()[1]}")
