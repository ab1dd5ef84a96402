"""More connections than there is room for: STOP has a way, signed-in pages keep theirs, the terminal is not flooded."""

import json
import subprocess
import sys
import threading
from contextlib import ExitStack
from socket import AF_UNIX, create_connection
from socket import socket as unix_socket

import httpx
import pytest
from websockets.exceptions import InvalidStatus

import console.connections
import console.server
from console.connections import OF_ONE_SESSION
from console.scene.scenes import Detail
from rtstack.access.tokens import Scope
from tests.support.console.client import cookie_header, socket, wait_for
from tests.support.console.served_console import serve_console

ROOM, MANY = 64, 300
# a server with 64 descriptors, and a client with 200 connections that say nothing: the newest one asks
FLOODED = """
import asyncio, resource, socket, sys
import console.connections as connections
async def answer(reader, writer):
    writer.write(await reader.readline())
    writer.close()
async def main():
    connections._RESERVED = -200 if sys.argv[1] == "beyond" else 40
    door = connections.Door(socket.create_server(("127.0.0.1", 0)))
    server = await asyncio.start_server(answer, sock=door, backlog=connections.AT_ONCE)
    print(server.sockets[0].getsockname()[1], flush=True)
    await asyncio.sleep(600)
resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
asyncio.run(main())
"""


@pytest.fixture
def small(tmp_path, monkeypatch):
    """A console with room for ROOM connections."""
    monkeypatch.setattr(console.connections, "_CONNECTIONS", ROOM)
    monkeypatch.setattr(console.connections, "_SILENCE_S", 1)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    (tmp_path / "logs").mkdir()
    with serve_console(tmp_path / "logs") as served:
        yield served


def is_open(stream):
    stream.settimeout(0.01)
    try:
        return stream.recv(1) != b""
    except TimeoutError:
        return True
    except ConnectionError:
        return False


@pytest.mark.parametrize("first", [b"", b"G", b"POST /api/stop HTTP/1.1\r\nHost: "], ids=["silent", "a byte", "a part"])
def test_strangers_make_room_for_stop_and_no_session_does(small, first):
    with small.signed_in() as (client, words), ExitStack() as stack:
        page = stack.enter_context(socket(small, "/live", client))
        page.recv(timeout=60)
        strangers = []
        for number in range(MANY):
            source = ("127.0.0.1" if number % 2 else f"127.0.3.{1 + number % 5}", 0)
            strangers.append(stack.enter_context(create_connection(("127.0.0.1", small.port), 60.0, source)))
            strangers[-1].sendall(first)
        answer = httpx.post(
            f"{small.base}/api/stop", headers={"cookie": small.cookie(client)} | words, trust_env=False, timeout=60.0
        )
        assert answer.status_code == 200
        assert small.mailbox.stop_requested
        small.mailbox.clear_stop()
        wait_for(lambda: sum(map(is_open, strangers)) <= ROOM // 2)
        for _ in range(3):
            assert json.loads(page.recv(timeout=60))["you"] == "operator 1"
        page.send("stop")
        wait_for(lambda: small.mailbox.stop_requested)


def test_clients_that_say_nothing_are_disconnected(small, monkeypatch):
    monkeypatch.setattr(console.server, "PATIENCE_S", 0.2)
    with ExitStack() as stack:
        silent = [stack.enter_context(create_connection(("127.0.0.1", small.port), 60.0)) for _ in range(8)]
        wait_for(lambda: not any(map(is_open, silent)))


@pytest.mark.parametrize("limit", ["within", "beyond"])
def test_a_server_without_descriptors_answers_the_newest_and_says_so_in_one_line(limit):
    server = subprocess.Popen(
        [sys.executable, "-c", FLOODED, limit], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with server, ExitStack() as stack:
        stack.callback(server.kill)
        assert server.stdout is not None
        port = int(server.stdout.readline())
        for number in range(200):
            stranger = stack.enter_context(create_connection(("127.0.0.1", port), 60.0))
            stranger.sendall(b"x" * (number % 2))
        newest = stack.enter_context(create_connection(("127.0.0.1", port), 60.0))
        newest.sendall(b"stop\n")
        assert newest.recv(64) == b"stop\n"
        server.kill()
        assert server.stderr is not None
        said = server.stderr.read()
        assert (said.count("\n"), "too many connections" in said) == (1, True), said


def test_a_session_opens_so_many_websockets_and_no_more(served):
    cookies, _ = served.second_session(Scope.VIEW)
    with served.signed_in() as (client, words), ExitStack() as stack:
        for _ in range(OF_ONE_SESSION):
            stack.enter_context(socket(served, "/live", additional_headers=cookie_header(cookies)))
        with pytest.raises(InvalidStatus):
            socket(served, "/live", additional_headers=cookie_header(cookies))
        stack.enter_context(socket(served, "/live", client)).recv(timeout=60)
        assert client.post("/api/stop", headers=words).status_code == 200


def test_stop_over_the_open_socket_of_a_viewer_is_reported_where_its_request_failed(served):
    cookies, _ = served.second_session(Scope.VIEW)
    with socket(served, "/live", additional_headers=cookie_header(cookies)) as page:
        page.recv(timeout=60)
        for word in ("Stop", '"stop"', "stop ", "beat"):
            page.send(word)
        page.ping().wait(60)
        assert not served.mailbox.stop_requested
        page.send("stop")
        wait_for(lambda: served.mailbox.stop_requested)
        assert served.stops_told() == 0
        page.send("report stop")
        wait_for(lambda: served.stops_told() == 1)


def test_the_limit_of_descriptors_is_raised_to_the_hard_one():
    code = (
        "import resource, console.connections as c; resource.setrlimit(resource.RLIMIT_NOFILE, (512, 3000)); "
        "c.raise_descriptor_limit(); print(*resource.getrlimit(resource.RLIMIT_NOFILE))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["3000", "3000"]


@pytest.mark.long
def test_the_scenes_port_has_room_for_the_proxy(served):

    with served.signed_in() as (client, _), ExitStack() as stack:
        server = served.parts.scenes.server(Detail.LIGHT)
        strangers = [stack.enter_context(create_connection(("127.0.0.1", server.port), 60.0)) for _ in range(100)]
        assert client.get("/viser/light/").status_code == 200
        wait_for(lambda: sum(map(is_open, strangers)) <= 16)
        with socket(served, "/viser/light", client) as page:
            assert page.recv(timeout=60)


def test_programs_that_say_nothing_leave_the_robot_process_its_threads(served):
    client = served.parts.client
    assert client.status().holder is None
    before = threading.active_count()
    with ExitStack() as stack:
        for _ in range(300):
            silent = stack.enter_context(unix_socket(AF_UNIX))
            silent.connect(str(client._path))
        assert client.status().holder is None  # its connection made room, and it opens another one
        wait_for(lambda: threading.active_count() <= before + 66)
        assert client.take("anna").holder == "anna"
