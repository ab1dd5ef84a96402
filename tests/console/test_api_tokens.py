"""Programs: bearer tokens, made at the console and in a terminal, and what they open."""

import json
import subprocess
import sys

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from rtstack.access.tokens import MAX_TOKENS, Scope, Tokens, TokensError


@pytest.fixture
def terminal(command_line):
    """What `rtstack token` says in a terminal: exit status, standard output, standard error."""

    def run(*words):
        done = command_line("token", *words)
        return done.returncode, done.stdout.strip(), done.stderr.strip()

    return run


def program(served, word):
    return httpx.Client(
        base_url=served.base, headers={"authorization": f"Bearer {word}"}, trust_env=False, timeout=60.0
    )


def test_a_program_with_a_token_does_what_the_page_does_without_cookie_or_word(served):
    with served.signed_in() as (client, headers):
        made = client.post("/api/tokens", json={"name": "bot", "scope": "operate"}, headers=headers).json()
    with program(served, made["word"]) as bot:
        assert bot.get("/api/me").json() == {"operator": "bot", "scope": "operate", "program": True}
        assert bot.post("/api/take", json={}).json()["holder"] == "bot"
        assert bot.post("/api/arm").json()["phase"] == "armed"
        assert bot.post("/api/sign-out").status_code == 409
        assert not bot.cookies
        (row,) = bot.get("/api/tokens").json()
        assert row == made["row"] | {"used_s": row["used_s"]}
        assert row["used_s"] >= row["created_s"]
        trail = bot.get("/api/audit", params={"limit": 3}).json()
    assert [(line["action"], line["operator"]) for line in trail] == [
        ("token", "operator 1"), ("take", "bot"), ("arm", "bot"),
    ]  # fmt: skip
    kept = served.parts.sign_in.tokens.path
    assert kept.stat().st_mode & 0o777 == 0o600
    for path in (served.logs / name for name in ("tokens.json", "audit.jsonl")):
        assert made["word"].encode() not in path.read_bytes(), path


def test_a_terminal_prints_an_address_that_signs_a_browser_in_once(served, terminal, tmp_path):
    status, address, _ = terminal("sign-in", "--logs", str(served.logs), "--console", served.base)
    assert (status, address.split("?")[0]) == (0, f"{served.base}/")
    for first in (True, False):
        with httpx.Client(trust_env=False, timeout=60.0) as browser:
            assert browser.get(address, follow_redirects=True).status_code == (200 if first else 403)
            assert browser.get(f"{served.base}/api/me").status_code == (200 if first else 401)
    assert served.parts.sign_in.tokens.all() == ()
    status, said, error = terminal("sign-in", "--logs", str(tmp_path), "--console", served.base)
    assert (status, said, "other logs" in error) == (2, "", True)
    status, said, error = terminal("sign-in", "--logs", str(tmp_path), "--console", "http://127.0.0.1:9")
    assert (status, said, "rtstack up" in error) == (2, "", True)


def test_a_revoked_token_is_worth_nothing_in_what_is_open_too(served):
    token, word = served.parts.sign_in.tokens.create("bot", Scope.OPERATE)
    headers = {"authorization": f"Bearer {word}"}
    with (
        program(served, word) as bot,
        connect(f"ws://127.0.0.1:{served.port}/live", additional_headers=headers, proxy=None) as live,
    ):
        assert json.loads(live.recv(timeout=60))["you"] == "bot"
        assert bot.post("/api/take", json={}).status_code == 200
        command = [sys.executable, "-m", "rtstack", "token", "revoke", token.id, "--logs", str(served.logs)]
        subprocess.run(command, check=True)  # another process
        answer = bot.get("/api/status")
        assert (answer.status_code, answer.headers["www-authenticate"]) == (401, "Bearer")
        with pytest.raises(ConnectionClosed):  # noqa: PT012
            for _ in range(200):
                live.recv(timeout=60)


def test_a_terminal_makes_lists_and_refuses_in_one_line(served, terminal):
    logs = ["--logs", str(served.logs)]
    status, word, advice = terminal("create", "--name", "screen", *logs)
    assert status == 0
    assert "cannot be shown again" in advice
    with program(served, word) as screen:
        assert screen.get("/api/me").json()["scope"] == "view"
        assert screen.post("/api/arm").status_code == 403
    ((action, who),) = served.trail()
    assert (action, who.endswith(", terminal")) == ("token", True)
    status, table, _ = terminal("list", *logs)
    assert (status, "screen" in table, word.split("_")[2] in table) == (0, True, False)
    for wrong in (
        ("create", "--name", "screen", *logs), ("create", "--name", "a\nb", *logs),
        ("create", "--name", "x", "--scope", "all", *logs), ("revoke", "../..", *logs), ("list", "--logs", "/nowhere"),
    ):  # fmt: skip
        status, said, line = terminal(*wrong)
        assert (status, said, line.count("\n")) == (2, "", 0), wrong
        assert line.startswith("rtstack: "), wrong


@pytest.mark.parametrize("spoilt", ["open to others", "no tokens", "of another form"])
def test_a_file_that_cannot_be_trusted_lets_nobody_in(tmp_path, spoilt):
    tokens = Tokens(tmp_path)
    _, word = tokens.create("bot", Scope.OPERATE)
    assert tokens.match(word).name == "bot"
    if spoilt == "open to others":
        tokens.path.chmod(0o644)
    else:
        tokens.path.write_text("{" if spoilt == "no tokens" else '[{"id": "00000000"}]')
    assert tokens.match(word) is None
    for use in (tokens.all, lambda: tokens.create("other", Scope.VIEW)):
        with pytest.raises(TokensError, match=r"tokens\.json"):
            use()


def test_only_the_whole_word_is_a_token_and_there_is_an_end_to_them(tmp_path):
    tokens = Tokens(tmp_path)
    token, word = tokens.create("bot", Scope.VIEW)
    for wrong in ("", word[:-1], word + "x", f"rtstack_{token.id}_", word.replace("rtstack", "other"), token.digest):
        assert tokens.match(wrong) is None
    for number in range(1, MAX_TOKENS):
        tokens.create(f"bot {number}", Scope.VIEW)
    with pytest.raises(TokensError, match="revoke one first"):
        tokens.create("one more", Scope.VIEW)
    assert len(Tokens(tmp_path).all()) == MAX_TOKENS


def test_two_sessions_never_share_a_name(served):
    sign_in = served.parts.sign_in
    _, word = sign_in.tokens.create("operator 1", Scope.OPERATE)
    with served.signed_in() as (client, headers), program(served, word) as bot:
        assert bot.get("/api/me").json()["operator"] == "operator 1 (2)"
        client.post("/api/take", json={}, headers=headers)
        answer = bot.post("/api/arm")
        assert answer.status_code == 409
        assert bot.post("/api/take", json={"operator": "operator 1"}).status_code == 409


@pytest.mark.parametrize("gone", ["moved", "replaced", "another stack's", "unreadable"])
def test_a_program_stops_while_the_folder_of_its_token_is_away_and_does_no_more(served, gone):
    token, word = served.parts.sign_in.tokens.create("bot", Scope.OPERATE)
    revoked, other = served.parts.sign_in.tokens.create("other", Scope.OPERATE)
    elsewhere = served.logs.with_name("elsewhere")
    with program(served, word) as bot, program(served, other) as out:
        assert [each.get("/api/me").status_code for each in (bot, out)] == [200, 200]
        served.parts.sign_in.tokens.revoke(revoked.id)
        if gone == "unreadable":
            served.parts.sign_in.tokens.path.chmod(0o644)
        else:
            served.logs.rename(elsewhere)
        if gone in ("replaced", "another stack's"):
            served.logs.mkdir()
        if gone == "another stack's":
            Tokens(served.logs).create("third", Scope.VIEW)
        assert bot.get("/api/me").status_code == 401
        assert bot.post("/api/take", json={}).status_code == 401
        assert bot.post("/api/stop").status_code == 200
        assert served.mailbox.stop_requested
        assert out.post("/api/stop").status_code == 401
        if gone == "unreadable":
            served.parts.sign_in.tokens.path.chmod(0o600)
        elif gone == "moved":
            elsewhere.rename(served.logs)
        if gone in ("unreadable", "moved"):
            assert bot.get("/api/me").status_code == 200
            served.parts.sign_in.tokens.revoke(token.id)
            assert bot.post("/api/stop").status_code == 401
