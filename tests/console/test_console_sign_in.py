"""Who gets in: the token once, the session afterwards, nobody else."""

import httpx
import pytest

from console.live.heartbeats import LOAD_S, OperatorHeartbeats
from console.sign_in import MAX_GUESSES
from rtstack.access.tokens import Scope
from tests.support.console.served_console import serve_console


def test_a_wrong_token_is_refused_and_does_not_spend_the_right_one(served):
    for wrong in ("", "x", served.parts.sign_in.token[:-1], "%00"):
        assert httpx.get(f"{served.base}/?token={wrong}", trust_env=False, timeout=60.0).status_code in (401, 403)
    with served.signed_in() as (client, _):
        assert client.get("/api/status").status_code == 200


def test_the_signed_in_browser_may_open_the_printed_address_again(served):
    token = served.parts.sign_in.token
    with served.signed_in() as (client, _):
        assert client.get("/", params={"token": token}).status_code == 303
        assert client.get("/api/status").status_code == 200


def test_without_a_session_nothing_answers(served):
    with httpx.Client(base_url=served.base, trust_env=False, timeout=60.0) as client:
        for path in ("/api/status", "/api/logs", "/api/events", "/viser/light/", "/api/logs/x/download"):
            answer = client.get(path)
            assert answer.status_code == 401, path
            assert "error" in answer.json()
        for path in (
            "/api/stop",
            "/api/take",
            "/api/arm",
            "/api/recover",
            "/api/jobs/trial",
            "/api/jobs/demonstration",
        ):
            assert client.post(path, json={}).status_code == 401, path
        front = client.get("/")
        assert front.status_code == 401
        assert "rtstack up" in front.text
    assert not served.mailbox.stop_requested


def attempt(served, code, source="127.0.0.1", **headers):
    """Bring a code as a program does, from a loopback address of its own; return the status."""
    transport = httpx.HTTPTransport(local_address=source)
    with httpx.Client(base_url=served.base, transport=transport, trust_env=False, timeout=60.0) as client:
        return client.post("/sign-in", data={"code": code}, headers=headers).status_code


def test_no_picture_and_no_stranger_makes_a_code_void(served):
    sign_in = served.parts.sign_in
    code = sign_in.pair(Scope.VIEW)
    wrong = f"{(int(code) + 1) % 10**6:06d}"
    for site in ("cross-site", "same-site"):
        for _ in range(2 * MAX_GUESSES):
            headers = {"sec-fetch-site": site, "sec-fetch-dest": "image"}
            assert (
                httpx.get(f"{served.base}/?code={wrong}", headers=headers, trust_env=False, timeout=60.0).status_code
                == 401
            )
        assert attempt(served, wrong, origin="http://evil.example") == 403
        assert attempt(served, wrong, origin="null") == 403
    assert sign_in.waits_s("127.0.0.1") == 0.0
    statuses = [attempt(served, wrong, "127.0.0.9") for _ in range(MAX_GUESSES + 1)]
    assert statuses == [403] * (MAX_GUESSES - 1) + [429, 429]
    assert attempt(served, code, "127.0.0.9") == 429  # it has to wait, and nobody else has
    assert attempt(served, code) == 303
    assert attempt(served, code) == 403
    refusals = [line.text for line in served.parts.audit.newest(1000) if line.action == "refused"]
    assert refusals == [
        "a code from 127.0.0.9 was refused", "a code, which has to wait now, from 127.0.0.9 was refused",
        "a code from 127.0.0.1 was refused",
    ]  # fmt: skip


def test_many_addresses_together_do_not_guess_a_code(served):
    sign_in = served.parts.sign_in
    code = sign_in.pair(Scope.VIEW)
    wrong = f"{(int(code) + 1) % 10**6:06d}"
    for number in range(200):
        assert sign_in.redeem_code(wrong, None, f"10.0.0.{number}") is None
    assert sign_in.redeem_code(code, None, "10.0.1.1") is None


def test_wrong_tokens_leave_lines_that_do_not_flood_the_trail(served):
    for number in range(60):
        headers = {"authorization": f"Bearer rtstack_{number:08x}_x"}
        transport = httpx.HTTPTransport(local_address=f"127.0.0.{2 + number % 30}")
        with httpx.Client(base_url=served.base, transport=transport, trust_env=False, timeout=60.0) as client:
            assert client.get("/api/me", headers=headers).status_code == 401
            assert client.get("/", params={"token": "x"}).status_code == 403
    lines = [line.text for line in served.parts.audit.newest(1000) if line.action == "refused"]
    assert len(lines) == len(set(lines)) == 20
    assert "a bearer token from 127.0.0.2 was refused" in lines


@pytest.mark.parametrize("led_by", ["another site", "the same browser"])
def test_a_link_signs_no_browser_over_before_our_own_page_is_confirmed(served, led_by):
    sign_in = served.parts.sign_in
    foreign = led_by == "another site"
    with served.signed_in() as (client, _):
        link = sign_in.invite(Scope.VIEW)
        browser = {} if foreign else {"cookie": served.cookie(client)}
        led = {"sec-fetch-site": "cross-site"} if foreign else {}
        shown = httpx.get(f"{served.base}/?token={link}", headers=browser | led, trust_env=False, timeout=60.0)
        assert (shown.status_code, "set-cookie" in shown.headers) == (200, False)
        assert ("operator 1" in shown.text, 'action="/sign-in" method="post"' in shown.text) == (not foreign, True)
        assert shown.headers["referrer-policy"] == "same-origin"  # else the form's Origin would be null
        form = {"data": {"token": link}, "trust_env": False, "timeout": 60.0}
        for origin in ("http://evil.example", "null"):
            answer = httpx.post(f"{served.base}/sign-in", headers=browser | {"origin": origin}, **form)
            assert answer.status_code == 403
        assert client.get("/api/me").json()["operator"] == "operator 1"
        answer = httpx.post(f"{served.base}/sign-in", headers=browser | {"origin": served.base}, **form)
        assert (answer.status_code, sign_in.cookie in answer.headers["set-cookie"]) == (303, True)
        assert client.get("/api/me").status_code == (200 if foreign else 401)


def test_a_restarted_console_knows_its_browsers_and_their_open_pages(tmp_path):
    with serve_console(tmp_path) as first, first.signed_in() as (client, headers):
        client.post("/api/take", json={"operator": "Ada"}, headers=headers).raise_for_status()
        sign_in = first.parts.sign_in
        key, stop = client.cookies[sign_in.cookie], client.cookies[sign_in.stop_cookie]
        left = sign_in.redeem(sign_in.invite(Scope.VIEW))
        assert left is not None
        sign_in.end(left)
    kept = tmp_path / "sessions.json"
    assert kept.stat().st_mode & 0o077 == 0
    assert key not in kept.read_text()
    with serve_console(tmp_path) as second:
        sign_in = second.parts.sign_in
        assert sign_in.browser(left.key) is None
        cookies = {sign_in.cookie: key}
        with httpx.Client(base_url=second.base, cookies=cookies, trust_env=False, timeout=60.0) as client:
            assert client.get("/api/me").json()["operator"] == "Ada"
            assert client.get("/api/status").json()["holder"] is None  # control is not kept
            assert client.post("/api/take", json={}, headers=headers).status_code == 200  # a page that stayed open
            assert client.get("/", params={"token": sign_in.token}).status_code == 303  # the new address, printed
            assert sign_in.token is None
            assert client.get("/api/me").json()["operator"] == "Ada"
        assert sign_in.stopper(stop) is not None


@pytest.mark.parametrize("content", ["", "[]", "{", '[{"digest": "x"}]'])
def test_a_broken_file_of_sessions_signs_out_and_does_no_other_harm(tmp_path, content):
    (tmp_path / "sessions.json").write_text(content)
    with serve_console(tmp_path) as served, served.signed_in() as (client, _):
        assert client.get("/api/me").json()["operator"] == "operator 1"


def test_an_operator_is_there_while_a_page_loads_or_is_frozen():
    now_s = 0.0
    beats = OperatorHeartbeats(lambda: now_s)
    assert not beats.heard("Ada")
    beats.load("Ada")
    now_s = LOAD_S - 0.1
    assert beats.heard("Ada")
    assert not beats.heard("Bob")
    now_s = LOAD_S
    assert not beats.heard("Ada")
    with beats.asleep("Ada"):
        assert beats.heard("Ada")
    assert not beats.heard("Ada")
