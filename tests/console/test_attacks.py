"""What an attacker may try with the console, in order, and what comes of it: nothing.

1 foreign Host, 2 foreign Origin, 3 a change without the session's word, 4 a stolen viewer's session, 5 a forged gizmo
message, 6 path traversal, 7 bodies and messages that are too long, 8 markup in names, 9 a replayed one-time token.
Each fails when its guard is taken away. test_attacks_on_the_wire.py has what needs raw bytes.
"""

import json
import re
import threading
import time
from contextlib import suppress
from pathlib import Path
from socket import create_connection

import httpx
import msgspec
import pytest
from fastapi.routing import APIRoute
from viser._messages import TransformControlsUpdateMessage
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import console.app
from console.guard import MAX_BODY_BYTES
from console.scene.scenes import Detail
from console.scene.server import SECRET_HEADER
from console.sign_in import INVITATION_S
from rtstack.access.tokens import Scope
from tests.support.console.client import SECRET, arm, cookie_header, has_ended, socket, wait_for
from tests.support.console.review_log import write_log

MARKUP = "<img src=x onerror=alert(1)>\"'"
FORGED = msgspec.msgpack.encode(
    {"type": "TransformControlsUpdateMessage", "name": "/grip/left", "wxyz": [1.0, 0, 0, 0], "position": [9.0, 9, 9]}
)


def changes(served):
    """Every change that the console offers, as (method, path), from its own table of routes, described or not."""
    found = [
        (method, re.sub(r"\{[a-z_:]+\}", "0" * 8, route.path))
        for module in console.app._ROUTES
        for route in module.router.routes
        if isinstance(route, APIRoute)
        for method in route.methods - {"GET", "HEAD", "OPTIONS"}
    ]
    described = served.application.openapi()["paths"].values()
    assert len(found) >= sum(method != "get" for operations in described for method in operations) > 25
    return found


def refused(served, path, **options):
    """The status with which a WebSocket is refused."""
    with pytest.raises(InvalidStatus) as refusal, socket(served, path, **options):
        pass
    return refusal.value.response.status_code


# 1: a name that an attacker's DNS server points at the loopback address


def test_a_foreign_host_name_is_refused(served):
    _, word = served.parts.sign_in.tokens.create("bot", Scope.OPERATE)
    with served.signed_in() as (client, headers):
        for way in (headers, {"authorization": f"Bearer {word}"}):
            for host in ("evil.example", f"evil.example:{served.port}", "127.0.0.1", f"127.0.0.1:{served.port + 1}"):
                assert client.get("/api/status", headers={**way, "host": host}).status_code == 400, host
                assert client.post("/api/stop", headers={**way, "host": host}).status_code == 400
            answer = client.get("/api/status", headers={**way, "host": f"localhost:{served.port}"})
            assert answer.status_code == 200
        cookie = served.cookie(client)
        with (
            pytest.raises(InvalidStatus) as refusal,
            connect(
                f"ws://evil.example:{served.port}/live",
                sock=create_connection(("127.0.0.1", served.port)),
                origin=served.base,
                additional_headers={"cookie": cookie},
                proxy=None,
            ),
        ):
            pass
        assert refusal.value.response.status_code == 403
    assert not served.mailbox.stop_requested


# 2: a page of another site, in the operator's browser


def test_a_foreign_origin_changes_nothing(served):
    _, word = served.parts.sign_in.tokens.create("bot", Scope.OPERATE)
    bearer = {"authorization": f"Bearer {word}"}
    with served.signed_in() as (client, headers):
        for origin in ("http://evil.example", "null", f"https://127.0.0.1:{served.port}", "http://127.0.0.1:1"):
            for way in (headers, bearer):
                assert client.post("/api/stop", headers={**way, "origin": origin}).status_code == 403, origin
        assert not served.mailbox.stop_requested
        assert client.post("/api/stop", headers={**headers, "origin": served.base}).status_code == 200
    assert served.mailbox.stop_requested


@pytest.mark.parametrize("path", ["/live", "/viser/light", "/api/teleoperation/hand"])
def test_a_websocket_needs_our_origin_and_a_session(served, path):
    _, word = served.parts.sign_in.tokens.create("bot", Scope.OPERATE)
    bearer = {"authorization": f"Bearer {word}"}
    with served.signed_in() as (client, _):
        cookie = {"cookie": served.cookie(client)}
        for options in (
            {"additional_headers": cookie, "origin": None},
            {"additional_headers": cookie, "origin": "http://evil.example"},
            {"additional_headers": bearer, "origin": "http://evil.example"},
            {"additional_headers": {"authorization": f"Bearer {word}x"}, "origin": None},
            {},
        ):
            assert refused(served, path, **options) == 403
        for options in ({"additional_headers": cookie}, {"additional_headers": bearer, "origin": None}):
            with socket(served, path, **options) as stream:
                if path.endswith("hand"):
                    stream.send("{}")
                assert stream.recv(timeout=60)


# 3: a form of another site, which brings the cookie along


def test_a_change_without_the_word_is_refused(served):
    with served.signed_in() as (client, headers):
        for method, path in changes(served):
            for word in ({}, {"x-csrf-token": "wrong"}, {"x-csrf-token": ""}):
                assert client.request(method, path, json={}, headers=word).status_code == 403, path
        assert not served.mailbox.stop_requested
        assert client.post("/api/stop", headers=headers).status_code == 200


# 4: a viewer's session, and one that is over


def test_a_viewers_session_looks_and_stops_and_no_more(served):
    cookies, word = served.second_session(Scope.VIEW)
    _, token = served.parts.sign_in.tokens.create("screen", Scope.VIEW)
    for headers in (cookie_header(cookies) | word, {"authorization": f"Bearer {token}"}):
        with httpx.Client(base_url=served.base, headers=headers, trust_env=False, timeout=60.0) as client:
            assert client.get("/api/status").status_code == 200
            for method, path in changes(served):
                if path not in ("/api/stop", "/api/sign-out"):
                    answer = client.request(method, path, json={})
                    assert (answer.status_code, "only look" in answer.text) == (403, True), path
            assert client.get("/api/tokens").status_code == 403
            assert refused(served, "/api/teleoperation/hand", additional_headers=headers) == 403
            with socket(served, "/live", additional_headers=headers) as page:
                assert page.recv(timeout=60)
            assert not served.mailbox.stop_requested
            told = served.stops_told()
            assert client.post("/api/stop").status_code == 200
            assert served.mailbox.stop_requested
            while served.stops_told() == told:
                time.sleep(0.01)
            served.mailbox.clear_stop()
    assert {action for action, _ in served.trail()} <= {"sign in", "stop"}


def test_a_viewers_gizmo_is_dropped_even_under_the_holders_name(served):
    server = served.parts.scenes.server(Detail.LIGHT)
    heard = []
    server.viser._websock_server.register_handler(TransformControlsUpdateMessage, lambda *_: heard.append(True))
    with served.signed_in() as (client, headers):
        arm(client, headers)
        wait_for(lambda: served.parts.watch.view.status.holder == "operator 1")
        cookies, _ = served.second_session(Scope.VIEW)
        theirs = cookie_header(cookies)
        viewer = served.parts.sign_in.session(next(iter(cookies.values())))
        object.__setattr__(viewer, "operator", "operator 1")  # as if names could be stolen
        with socket(served, "/viser/light", additional_headers=theirs) as page:
            page.recv(timeout=60)
            page.send(FORGED)
            with socket(served, "/viser/light", client) as own:
                own.recv(timeout=60)
                own.send(FORGED)
                wait_for(lambda: heard)
                page.send(FORGED)
                page.ping().wait(10)
                own.send(FORGED)
                wait_for(lambda: len(heard) > 1)
    assert len(heard) == 2


def test_a_session_that_signed_out_is_over_and_so_is_what_it_had_open(served):
    with served.signed_in() as (client, headers):
        arm(client, headers)
        cookie = {"cookie": served.cookie(client)}
        paths = ("/live", "/viser/light", "/api/teleoperation/hand")
        opened = [socket(served, path, client) for path in paths]
        assert client.post("/api/sign-out", headers=headers).json() == {"signed_out": True}
        assert client.get("/api/status").status_code == 401
        assert client.post("/api/arm", headers=headers).status_code == 401
        assert refused(served, "/live", additional_headers=cookie) == 403
        assert served.job_manager.status().holder is None
        server = served.parts.scenes._made[Detail.LIGHT].server
        opened[2].send('{"clutch": true}')
        for page in opened:
            server.viser.scene.add_frame("/nudge")  # the scene speaks when something changes
            wait_for(lambda page=page: has_ended(page))
    assert ("sign out", "operator 1") in served.trail()


def test_a_programs_session_cannot_be_had_as_a_cookie(served):
    _, word = served.parts.sign_in.tokens.create("bot", Scope.OPERATE)
    key = served.parts.sign_in.program(word).key
    for value in (word, key, "A" * 43):
        cookies = {served.parts.sign_in.cookie: value}
        assert httpx.get(f"{served.base}/api/status", cookies=cookies, trust_env=False, timeout=60.0).status_code == 401


# 5: viser itself would take any message from anywhere


def test_the_raw_port_refuses_everybody_but_our_proxy(served):
    server = served.parts.scenes.server(Detail.LIGHT)
    base = f"127.0.0.1:{server.port}/"
    for headers in ({}, {SECRET_HEADER: "guess"}, {SECRET_HEADER: ""}, {"host": f"127.0.0.1:{served.port}"}):
        answer = httpx.get(f"http://{base}", headers=headers, trust_env=False, timeout=60.0)
        assert (answer.status_code, answer.content) == (403, b"")
        with (
            pytest.raises(InvalidStatus) as refusal,
            connect(f"ws://{base}", additional_headers=headers, subprotocols=["viser-v1.1.1"], proxy=None) as forger,
        ):
            forger.send(FORGED)
        assert refusal.value.response.status_code == 403
    assert (
        httpx.get(f"http://{base}", headers={SECRET_HEADER: server.secret}, trust_env=False, timeout=60.0).status_code
        == 200
    )


# 6: out of the folder of logs


STEPS = ("..", "%2e%2e", "%252e%252e", "..%2f..", "..%5c..", "....//", "%c0%ae%c0%ae")


def test_no_path_leads_out(served):
    for folder in (served.logs.parent, served.logs):
        (folder / "secret.txt").write_text(SECRET)
    (served.logs / "a.mcap").write_bytes(b"x")
    with served.signed_in() as (client, headers):
        for step in STEPS:
            for base in ("/api/logs/", "/logs/", "/api/recordings/", "/recordings/", "/static/", "/viser/light/"):
                for path in (f"{step}/secret.txt", f"x/{step}/secret.txt", f"{step}%2fa.mcap"):
                    answer = client.get(f"{base}{path}")
                    assert answer.status_code in (404, 422), (base, path)
                    assert SECRET not in answer.text
            order = {"reference": f"{step}/secret.txt", "object": "rice_box"}
            assert client.post("/api/jobs/trial", json=order, headers=headers).status_code == 404
        ids = [f"{step}%2fsecret.txt" for step in STEPS] + ["secret.txt", "a.mcap", "%00", "%2fetc%2fpasswd"]
        for log_id in ids:
            assert client.get(f"/api/logs/{log_id}/download").status_code == 404, log_id
            assert client.post(f"/api/recordings/{log_id}/discard", headers=headers).status_code in (404, 405), log_id
        for odd in ("%00", "%0a", "%7f", "%3f", "%ff", "a" * 3000):
            assert client.get(f"/viser/light/{odd}").status_code in (200, 404), odd
    assert (served.logs / "a.mcap").exists()


# 7: more than can be meant


def test_a_body_that_is_too_long_is_refused_whether_it_says_so_or_not(served):
    with served.signed_in() as (client, headers):
        for path in ("/api/take", "/api/arm"):  # the second one reads no body
            answer = client.post(path, content=b" " * (MAX_BODY_BYTES + 1), headers=headers)
            assert (answer.status_code, list(answer.json())) == (413, ["error"])
        json_type = {"content-type": "application/json"}
        answer = client.post("/api/take", content=_parts(MAX_BODY_BYTES + 1), headers=headers | json_type)
        assert answer.status_code == 413
        fits = b'{"operator": "anna"}'
        answer = client.post("/api/take", content=fits.ljust(MAX_BODY_BYTES), headers=headers | json_type)
        assert answer.json()["holder"] == "anna"


def _parts(size):
    """Send a body without saying how long it is."""
    for _ in range(0, size, 4096):
        yield b" " * 4096
    yield b"{}"


@pytest.mark.parametrize("path", ["/live", "/api/teleoperation/hand"])
def test_a_message_that_is_too_long_ends_its_socket(served, path):
    """Its announcement is enough. Who goes on sending meets a socket that is shut, and may never read the reason."""
    size = 1 << 21
    with served.signed_in() as (client, _):
        with socket(served, path, client) as page:
            page.socket.sendall(b"\x81\xff" + size.to_bytes(8, "big") + bytes(4))  # RFC 6455, 5.2: a masked text
            wait_for(lambda: has_ended(page))
            assert page.close_code == 1009
        with socket(served, path, client) as page:
            with suppress(ConnectionClosed):
                page.send("x" * size)
            wait_for(lambda: has_ended(page))
        assert client.get("/api/status").status_code == 200


# 8: names that a page would run


def test_markup_in_names_is_shown_and_never_run(served):
    name = f"{MARKUP}.mcap".replace("/", "")
    write_log(served.logs / name, {"object": MARKUP, "specification": json.dumps({"controller": MARKUP})})
    with served.signed_in() as (client, headers):
        (row,) = client.get("/api/logs").json()
        assert row["name"] == name
        for path in ("/", "/logs", f"/logs/{row['id']}"):
            page = client.get(path)
            assert page.headers["content-type"].startswith("text/html")
            assert "<img" not in page.text, path
        assert "&lt;img src=x" in page.text
        assert client.post("/api/take", json={"operator": MARKUP}, headers=headers).json()["holder"] == MARKUP
        made = client.post("/api/tokens", json={"name": MARKUP}, headers=headers).json()
        assert made["row"]["name"] == MARKUP
        unknown = client.get(f"/api/logs/{MARKUP}")
        for answer in (client.get("/api/status"), client.get("/api/audit"), client.get("/api/tokens"), unknown):
            assert answer.headers["content-type"] == "application/json"
            assert answer.headers["x-content-type-options"] == "nosniff"


def test_no_script_of_ours_makes_markup_of_a_name():
    scripts = sorted((Path(console.__file__).parent / "static" / "js").rglob("*.js"))
    assert len(scripts) > 20
    for script in scripts:
        for use in re.findall(
            r"(?:(?:inner|outer)HTML\s*\+?=|insertAdjacentHTML|document\.write).*", script.read_text()
        ):
            assert re.fullmatch(r"innerHTML = '[^'$]*';", use), f"{script}: {use}"  # a constant, nothing put into it


# 9: the address from the terminal's scrollback


def test_a_token_signs_in_once_even_when_two_bring_it_at_once(served):
    token, cookies = served.parts.sign_in.token, []

    def bring():
        barrier.wait()
        answer = httpx.get(f"{served.base}/", params={"token": token}, trust_env=False, timeout=60.0)
        cookies.append(answer.cookies.get(served.parts.sign_in.cookie))

    barrier = threading.Barrier(4)
    threads = [threading.Thread(target=bring) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(cookies) == 4
    assert sum(cookie is not None for cookie in cookies) == 1
    replayed = httpx.get(f"{served.base}/?token={token}", trust_env=False, timeout=60.0)
    assert replayed.status_code == 403
    assert "works once" in replayed.text
    assert "set-cookie" not in replayed.headers


def test_an_invitation_works_once_with_its_scope_and_not_for_ever(served, monkeypatch):
    with served.signed_in() as (client, headers):
        invitations = [client.post("/api/invitations", json={}, headers=headers).json() for _ in range(2)]
    first, second = (invitation["address"] for invitation in invitations)
    with httpx.Client(trust_env=False, timeout=60.0, follow_redirects=True) as viewer:
        viewer.head(first)  # a preview does not spend it
        assert viewer.get(first).status_code == 200
        assert viewer.get(f"{served.base}/api/me").json() == {"operator": "viewer 2", "scope": "view", "program": False}
    assert httpx.get(first, trust_env=False, timeout=60.0).status_code == 403
    later_s = time.monotonic() + INVITATION_S + 1.0
    monkeypatch.setattr("console.sign_in._now_s", lambda: later_s)
    assert httpx.get(second, trust_env=False, timeout=60.0).status_code == 403


# and what stands around all of it


def test_every_answer_carries_the_security_headers(served):
    with served.signed_in() as (client, _):
        for path in ("/", "/api/status", "/static/css/tokens.css", "/no/such/page", "/viser/light/"):
            headers = client.get(path).headers
            assert headers["x-content-type-options"] == "nosniff"
            assert headers["referrer-policy"] == "no-referrer"
            assert "frame-ancestors" in headers["content-security-policy"]
        policy = client.get("/").headers["content-security-policy"]
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy
        assert "frame-ancestors 'self'" in client.get("/viser/light/").headers["content-security-policy"]


def test_no_page_has_anything_inline():
    pages = set((Path(console.__file__).parent / "pages").glob("*.html"))
    # a package's own markup, in a frame without an origin: tests/browser/test_panels_page.py
    pages -= {Path(console.__file__).parent / "pages" / "panel_frame.html"}
    assert len(pages) >= 3
    for page in pages:
        text = page.read_text()
        assert not re.search(r"<script(?![^>]*\bsrc=)", text), page
        assert not re.search(r"<style|\sstyle=|\son[a-z]+=", text), page
        assert "http://" not in text
        assert "https://" not in text


def test_an_unknown_address_of_the_interface_is_one_line_and_any_other_a_page(served):
    with served.signed_in() as (client, _):
        answer = client.get("/api/no/such/thing")
        assert answer.status_code == 404
        assert list(answer.json()) == ["error"]
        for path, said in (
            ("/no/such/<page>", "Nothing is at /no/such/&lt;page&gt;"), ("/logs/0000000000000000", "does not exist"),
        ):  # fmt: skip
            answer = client.get(path)
            assert answer.status_code == 404
            assert said in answer.text
            assert 'id="stop"' in answer.text
    assert httpx.get(f"{served.base}/docs", trust_env=False, timeout=60.0).status_code == 401
