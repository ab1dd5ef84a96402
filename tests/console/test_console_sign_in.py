"""Who gets in: the token once, the session afterwards, nobody else."""

import httpx


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
