"""What other sites may do with a signed-in browser: nothing."""

import re
from pathlib import Path

import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

import console

CHANGES = tuple(f"/api/{verb}" for verb in ("take", "release", "beat", "arm", "disarm", "stop", "recover"))


def test_a_foreign_host_name_is_refused(served):
    with served.signed_in() as (client, headers):
        for host in ("evil.example", f"evil.example:{served.port}", "127.0.0.1", f"127.0.0.1:{served.port + 1}"):
            answer = client.get("/api/status", headers={"host": host})
            assert answer.status_code == 400, host
            assert client.post("/api/stop", headers={**headers, "host": host}).status_code == 400
        assert client.get("/api/status", headers={"host": f"localhost:{served.port}"}).status_code == 200
    assert not served.mailbox.stop_requested


def test_a_foreign_origin_changes_nothing(served):
    with served.signed_in() as (client, headers):
        for origin in ("http://evil.example", "null", f"https://127.0.0.1:{served.port}", "http://127.0.0.1:1"):
            assert client.post("/api/stop", headers={**headers, "origin": origin}).status_code == 403, origin
        assert not served.mailbox.stop_requested
        assert client.post("/api/stop", headers={**headers, "origin": served.base}).status_code == 200
    assert served.mailbox.stop_requested


def test_a_change_without_the_word_is_refused(served):
    with served.signed_in() as (client, headers):
        for path in (*CHANGES, "/api/jobs/demonstration", "/api/jobs/trial"):
            assert client.post(path, json={}).status_code == 403, path
            assert client.post(path, json={}, headers={"x-csrf-token": "wrong"}).status_code == 403, path
        assert not served.mailbox.stop_requested
        assert client.post("/api/stop", headers=headers).status_code == 200


@pytest.mark.parametrize(("path", "subprotocols"), [("/live", None), ("/viser/light", ["viser-v1.1.1"])])
def test_a_websocket_needs_our_origin_and_a_session(served, path, subprotocols):
    with served.signed_in() as (client, _):
        cookie = served.cookie(client)
        address = f"ws://127.0.0.1:{served.port}{path}"
        refused = [
            {"additional_headers": {"cookie": cookie}},
            {"additional_headers": {"cookie": cookie}, "origin": "http://evil.example"},
            {"origin": served.base},
        ]
        for options in refused:
            with (
                pytest.raises(InvalidStatus) as refusal,
                connect(address, proxy=None, subprotocols=subprotocols, **options),
            ):
                pass
            assert refusal.value.response.status_code == 403
        ours = {"additional_headers": {"cookie": cookie}, "origin": served.base}
        with connect(address, proxy=None, subprotocols=subprotocols, **ours) as stream:
            assert stream.recv(timeout=10)


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
    pages = sorted((Path(console.__file__).parent / "pages").glob("*.html"))
    assert len(pages) >= 3
    for page in pages:
        text = page.read_text()
        assert not re.search(r"<script(?![^>]*\bsrc=)", text), page
        assert not re.search(r"<style|\sstyle=|\son[a-z]+=", text), page
        assert "http://" not in text
        assert "https://" not in text


def test_an_unknown_page_is_one_line(served):
    with served.signed_in() as (client, _):
        answer = client.get("/no/such/page")
        assert answer.status_code == 404
        assert list(answer.json()) == ["error"]
    assert httpx.get(f"{served.base}/docs", trust_env=False).status_code == 401
