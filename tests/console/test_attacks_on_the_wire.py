"""What an attacker may try below HTTP's polite forms, and around the edges of signing in: raw bytes on real sockets.

Odd hosts, smuggled requests, forms, bodies and messages that are hard to read, clients that never finish, names and
links in the folder of logs, sessions that are fixed or over, and names that are somebody else's.
"""

import errno
import gzip
import os
import signal
import threading
from socket import create_connection

import httpx
import psutil
import pytest

import console.server
from console.child_process import MEMORY_GB, start, why_ended
from rtstack.access.tokens import Scope
from tests.support.console.client import SECRET, cookie_header, has_ended, socket, wait_for
from tests.support.console.review_log import write_log

HOSTS = ("[::1]:{}", "LOCALHOST:{}", "localhost.:{}", "127.1:{}", "2130706433:{}", "0.0.0.0:{}", "127.0.0.1:0{}",
         "127.0.0.1:{}@evil.example", "127.0.0.1:{}, evil.example", "evil.example/127.0.0.1:{}", "")  # fmt: skip
LENGTHS = (
    "Content-Length: +5", "Content-Length: 5, 6", "Content-Length: 5\r\nContent-Length: 6", "Content-Length: -1",
    "Content-Length: 0x5", "Content-Length : 5", "Content-Length: \xb25", "Content-Length: 99999999999999999999999",
    "Content-Length: 5\r\nTransfer-Encoding: chunked", "Transfer-Encoding: chunked\r\nContent-Length: 0",
    "Transfer-Encoding: xchunked", "Transfer-Encoding: chunked, identity", "Transfer-Encoding : chunked",
)  # fmt: skip
FORMS = ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x", "")
UNREADABLE = {
    "deep": b"[" * 200_000, "deep objects": b'{"a":' * 40_000, "lone surrogate": b'{"operator": "\\ud800"}',
    "surrogate key": b'{"\\ud800": 1}', "long number": b'{"operator": ' + b"9" * 10_000 + b"}", "nul": b'"\\u0000"',
    "bytes": b"\xff\xfe\x00", "bomb": gzip.compress(bytes(50 << 20)), "two lines": b'{"a\\nb": 1}',
}  # fmt: skip


def raw(served, request, wait_s=20.0):
    """Send bytes, return all that comes back until the console closes the connection."""
    with create_connection(("127.0.0.1", served.port), timeout=wait_s) as stream:
        stream.sendall(request.encode("latin-1"))
        answer = b""
        while part := stream.recv(65536):
            answer += part
    return answer


def headers_of(served, client, words):
    return "".join(
        f"{name}: {value}\r\n"
        for name, value in {"host": f"127.0.0.1:{served.port}", "cookie": served.cookie(client), **words}.items()
    )


def test_a_host_is_ours_to_the_letter_and_a_length_is_one_number(served):
    with served.signed_in() as (client, words):
        for host in HOSTS:
            assert client.get("/api/status", headers={"host": host.format(served.port)}).status_code == 400, host
        ours = headers_of(served, client, words)
        assert raw(served, f"GET /api/status HTTP/1.1\r\nHost: evil\r\n{ours}\r\n").startswith(b"HTTP/1.1 400")
        assert raw(served, "GET /api/status HTTP/1.0\r\n\r\n").startswith(b"HTTP/1.1 400")
        smuggled = f"POST /api/stop HTTP/1.1\r\n{ours}Connection: close\r\n\r\n"
        for length in LENGTHS:
            request = f"POST /api/take HTTP/1.1\r\n{ours}{length}\r\nConnection: close\r\n\r\n0\r\n\r\n{smuggled}"
            answer = raw(served, request)
            assert answer.startswith(b"HTTP/1.1 400"), length
            assert answer.count(b"HTTP/1.1") == 1, length
            assert not served.mailbox.stop_requested, length
        assert raw(served, smuggled).startswith(b"HTTP/1.1 200")
        assert served.mailbox.stop_requested


def test_a_form_changes_nothing_even_where_a_browser_would_send_it_unasked(served):
    with served.signed_in() as (client, words):
        for kind in FORMS:
            for origin in ({}, {"origin": "null"}, {"origin": "http://evil.example"}):
                for path in ("/api/stop", "/api/take"):
                    answer = client.post(path, content=b'{"operator": "eve"}', headers={"content-type": kind, **origin})
                    assert answer.status_code == 403, (kind, origin)
            answer = client.post("/api/take", content=b'{"operator": "eve"}', headers={"content-type": kind, **words})
            assert answer.status_code == 422, kind  # our own page says what it sends
        assert not served.mailbox.stop_requested
        assert served.job_manager.status().holder is None


def test_what_is_hard_to_read_is_refused_in_one_line_and_ends_nothing_but_its_own_socket(served, caplog):
    with served.signed_in() as (client, words):
        kinds = words | {"content-type": "application/json"}
        for name, body in UNREADABLE.items():
            for more in ({}, {"content-encoding": "gzip"}):
                answer = client.post("/api/take", content=body, headers=kinds | more)
                assert (answer.status_code in (400, 422), list(answer.json())) == (True, ["error"]), name
                assert "\n" not in answer.json()["error"]
        feed = client.get("/api/foxglove").json()["address"].removeprefix(f"ws://127.0.0.1:{served.port}")
        for path, protocols in (("/live", None), ("/api/teleoperation/hand", None), (feed, ["foxglove.sdk.v1"])):
            with socket(served, path, client, subprotocols=protocols) as page:
                for name in ("deep", "surrogate key", "long number", "nul"):
                    page.send(UNREADABLE[name].decode())
                page.ping().wait(20)
                page.send(b"\x00\xff")  # no text: not for us
                wait_for(lambda page=page: has_ended(page))
                assert page.close_code == 1003, path
        assert client.get("/api/status").status_code == 200
    assert [record for record in caplog.records if record.exc_info] == []


@pytest.mark.long
def test_clients_that_never_finish_are_cut_off_and_hold_nobody_up(served, monkeypatch):
    monkeypatch.setattr(console.server, "PATIENCE_S", 3.0)
    with served.signed_in() as (client, words), socket(served, "/live", client) as page:
        ours = headers_of(served, client, words)
        unfinished = (
            "", "POST /api/stop HTTP/1.1\r\nHost: ", f"POST /api/take HTTP/1.1\r\n{ours}Content-Length: 99\r\n\r\n{{",
            f"GET /api/me HTTP/1.1\r\n{ours}\r\nGET /api/me",
        )  # fmt: skip
        slow = [create_connection(("127.0.0.1", served.port), timeout=60.0) for _ in range(100)]
        for number, stream in enumerate(slow):
            stream.sendall(unfinished[number % len(unfinished)].encode())
        assert client.post("/api/stop", headers=words).status_code == 200
        for stream in slow:  # each ends, by the console's will
            while stream.recv(65536):
                pass
            stream.close()
        page.recv(timeout=60)  # what has arrived whole is not cut off
        assert client.get("/api/me").status_code == 200


def test_a_log_is_a_file_of_the_folder_with_a_name_that_harms_no_header(served):
    outside = served.logs.parent / "secret.mcap"
    outside.write_text(SECRET)
    (served.logs / "folder").mkdir()
    (served.logs / "folder" / "inside.mcap").write_bytes(b"x")
    for name, target in (("stolen", outside), ("loop", "loop.mcap"), ("inner", "folder/inside.mcap")):
        (served.logs / f"{name}.mcap").symlink_to(target)
    os.mkfifo(served.logs / "pipe.mcap")
    (served.logs / "directory.mcap").mkdir()
    (served.logs / "notes.txt").write_text("mine")
    odd = ['a"; filename="b.mcap', "x\r\nset-cookie: a=b.mcap", "caf\xe9 \u202e.mcap", "%2e%2e%2f.mcap"]
    for name in odd:
        (served.logs / name).write_bytes(b"x")
    with open(os.fsencode(served.logs) + b"/\xff.mcap", "wb"):  # a name that no text has
        pass
    with served.signed_in() as (client, _):
        rows = client.get("/api/logs").raise_for_status().json()
        assert {row["name"] for row in rows} == {*odd, "inner.mcap"}
        for row in rows:
            assert (row["outcome"], row["recording"]) == ("not a log of rtstack", False)
            assert row["name"] not in row["id"]
            answer = client.get(f"/api/logs/{row['id']}/download")
            assert (answer.status_code, answer.content) == (200, b"x"), row["name"]
            assert "set-cookie" not in answer.headers
            said = answer.headers["content-disposition"]
            assert said.startswith("attachment; filename")
            assert said.count("filename") == 1 + row["name"].count("filename")
            assert said.isascii()
            assert said.isprintable()


def test_no_session_is_fixed_in_advance_and_none_comes_back(served):
    sign_in = served.parts.sign_in
    address = f"{served.base}/?token={sign_in.token}"
    fixed = {"cookie": f"{sign_in.cookie}={'A' * 43}"}  # an attacker's choice
    answer = httpx.get(address, headers=fixed, trust_env=False, timeout=60.0)
    assert (answer.status_code, answer.headers["location"]) == (303, "/")  # without the token
    assert "httponly" in answer.headers["set-cookie"].lower()
    assert "samesite=strict" in answer.headers["set-cookie"].lower()
    key = answer.cookies[sign_in.cookie]
    ours = {"cookie": f"{sign_in.cookie}={key}", "x-csrf-token": sign_in.session(key).csrf}
    for headers, status in ((fixed, 401), (ours, 200)):
        assert httpx.get(f"{served.base}/api/me", headers=headers, trust_env=False, timeout=60.0).status_code == status
    assert 'id="stop"' in httpx.get(f"{served.base}/", headers=ours, trust_env=False, timeout=60.0).text
    httpx.post(f"{served.base}/api/sign-out", headers=ours, trust_env=False, timeout=60.0).raise_for_status()
    for headers in (fixed, ours, {}):
        assert httpx.get(address, headers=headers, trust_env=False, timeout=60.0).status_code == 403
        assert httpx.get(f"{served.base}/api/me", headers=headers, trust_env=False, timeout=60.0).status_code == 401
    second = sign_in.redeem(sign_in.invite(Scope.OPERATE))
    third = sign_in.redeem(sign_in.invite(Scope.VIEW), second)
    assert (sign_in.session(second.key), third.scope) == (None, Scope.VIEW)  # who signs in again keeps no old right


def test_of_two_who_take_over_at_once_one_has_the_robot_and_nobody_takes_a_name(served):
    answers, over = [], threading.Event()
    names = [f"rival {number}" for number in range(4)]

    def live():
        while not over.wait(0.1):
            for name in ("anna", "carla", *names):  # a busy machine takes longer than a lease
                served.parts.heartbeats.note(name)

    def take_over(name):
        cookies, csrf = served.second_session()
        barrier.wait()
        order = {"operator": name, "over_from": "anna"}
        with httpx.Client(headers=cookie_header(cookies) | csrf, trust_env=False, timeout=60.0) as rival:
            answers.append(rival.post(f"{served.base}/api/take", json=order))

    barrier = threading.Barrier(len(names))
    threads = [threading.Thread(target=live), *(threading.Thread(target=take_over, args=(name,)) for name in names)]
    with served.signed_in() as (client, words):
        wait_for(lambda: served.parts.watch.view.status is not None)
        assert client.post("/api/take", json={"operator": "anna"}, headers=words).json()["holder"] == "anna"
        for thread in threads:
            thread.start()
        for thread in threads[1:]:
            thread.join()
        assert sorted(answer.status_code for answer in answers) == [200, 409, 409, 409]
        winner = next(answer.json()["holder"] for answer in answers if answer.status_code == 200)
        assert [operator for action, operator in served.trail() if action == "takeover"] == [winner]
        served.parts.client.take("carla", winner)  # a program without a session: her name looks free, and is hers
        answer = client.post("/api/take", json={"operator": "carla"}, headers=words)
        assert (answer.status_code, answer.json()["error"].split(";")[0]) == (409, "carla has control")
        over.set()
        threads[0].join()


def test_a_full_disk_and_an_error_of_our_own_are_answered_in_our_own_form(served, monkeypatch):
    write_log(served.logs / "a.mcap", {})
    full, odd = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/srv/index.json"), ValueError("secret detail")
    with served.signed_in() as (client, _):
        (row,) = client.get("/api/logs").json()
        for error, status, said in ((full, 507, "index.json: No space left on device"), (odd, 500, "ValueError")):
            with monkeypatch.context() as patch:
                patch.setattr(served.parts.review_cache, "open", lambda _, error=error: raised(error))
                answer = client.get(f"/api/logs/{row['id']}")
            assert (answer.status_code, list(answer.json())) == (status, ["error"])
            assert said in answer.json()["error"]
            assert "secret" not in answer.text
        monkeypatch.setattr("console.review.cache._READER", "no/such/folder")  # its note cannot be written
        assert client.get(f"/api/logs/{row['id']}").status_code == 404
        assert served.parts.review_cache._readers == {}
        assert [child for child in psutil.Process().children() if "console.review.conversion" in child.cmdline()] == []


def raised(error):
    raise error


def test_a_program_that_reads_logs_gets_so_much_memory(tmp_path):
    errors = tmp_path / "errors"
    with errors.open("wb") as file:
        status = start("timeit", "-n1", "-r1", f"bytearray({MEMORY_GB + 1} << 30)", stderr=file.fileno()).wait(120)
    assert (status, "MemoryError" in errors.read_text()) == (1, True)
    assert "4 GB" in why_ended(-signal.SIGXCPU)
