"""HTTPS: a client that trusts the authority gets in, no other one; codes; what is not HTTPS is refused."""

import os
import re
import socket
import ssl
import subprocess
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest

import console.sign_in
from console.address import Address
from console.session_file import SessionFile
from console.sign_in import CODE_DIGITS, MAX_GUESSES, PAIRING_S, SignIn
from hal.base.configuration import ConfigurationError
from rtstack.access.authority import Authority
from rtstack.access.tokens import Scope, Tokens
from rtstack.cli.console_client import open_stream
from rtstack.live.audit import AuditTrail
from rtstack.trials.errors import TrialError

COMMAND = Path(sys.executable).with_name("rtstack")
HOST = "127.0.0.97"  # not the default one


@dataclass
class Secured:
    """A stack over HTTPS. line, said: what it printed; trusting: the context of a client that trusts its authority."""

    base: str
    token: str
    said: str
    config: Path
    trusting: ssl.SSLContext

    @property
    def port(self) -> int:
        return int(self.base.rpartition(":")[2])

    def client(self) -> httpx.Client:
        return httpx.Client(base_url=self.base, verify=self.trusting, trust_env=False, timeout=60.0)


@pytest.fixture(scope="module")
def secured(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Secured]:
    folder = tmp_path_factory.mktemp("https")
    process = subprocess.Popen(
        [str(COMMAND), "up", "--port", "0", "--https", "--host", HOST, "--logs", str(folder / "logs")],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "XDG_CONFIG_HOME": str(folder)},
    )  # fmt: skip
    assert process.stdout is not None
    found = re.fullmatch(r"rtstack is up: (https://\S+?)/\?token=(\S+)\n", process.stdout.readline())
    assert found is not None
    assert process.stderr is not None
    said = process.stderr.readline() + process.stderr.readline()
    authority = folder / "rtstack" / "https" / "authority.pem"
    yield Secured(*found.groups(), said, folder, ssl.create_default_context(cafile=str(authority)))
    process.terminate()
    assert process.communicate(timeout=60)[1] == ""


def test_a_client_that_trusts_the_authority_signs_in_and_is_told_of_it_in_the_terminal(secured: Secured) -> None:
    authority = Authority(secured.config / "rtstack" / "https")
    assert authority.fingerprint in secured.said
    assert str(authority.certificate) in secured.said
    assert (authority.folder / "authority.key").stat().st_mode & 0o777 == 0o600
    with secured.client() as client:
        answer = client.get("/", params={"token": secured.token})
        assert answer.status_code == 303
        assert all("; Secure" in cookie for cookie in answer.headers.get_list("set-cookie"))
        page = client.get("/").text
        word = re.search(r'name="csrf-token" content="([^"]+)"', page)
        assert word is not None
        headers = {"x-csrf-token": word.group(1), "origin": secured.base}
        assert client.post("/api/take", json={"operator": "anna"}, headers=headers).status_code == 200
        downgraded = headers | {"origin": secured.base.replace("https", "http")}
        assert client.post("/api/take", json={"operator": "anna"}, headers=downgraded).status_code == 403
        cookies = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
        headers_of_page = {"cookie": cookies, "origin": secured.base}
        with open_stream(secured.base, "/live", headers_of_page, secured.trusting) as live:
            assert live.recv(60.0)
        headset = client.get("/headset")  # no other site frames it, or gets a headset by it
        assert "frame-ancestors 'none'" in headset.headers["content-security-policy"]
        assert "xr-spatial-tracking=(self)" in headset.headers["permissions-policy"]
        for site in ("https://webxr.example", secured.base.replace("https", "http"), "null"):
            hand = "/api/teleoperation/hand"
            with (
                pytest.raises(TrialError, match="403"),
                open_stream(secured.base, hand, {"cookie": cookies, "origin": site}, secured.trusting),
            ):
                pass
        invited = client.post("/api/invitations", json={"scope": "view"}, headers=headers).json()["address"]
        assert invited.startswith(f"{secured.base}/?token=")
        paired = client.post("/api/pairings", json={"scope": "view"}, headers=headers).json()
        assert paired["address"] == secured.base
    with secured.client() as headset:
        assert headset.get("/", params={"code": paired["code"]}).status_code == 303
        assert headset.get("/api/me").json()["scope"] == "view"
    with secured.client() as late:
        assert late.get("/", params={"code": paired["code"]}).status_code == 403
        assert late.get("/api/me").status_code == 401


def test_a_program_loses_no_connection_as_it_opens(secured: Secured) -> None:
    """A client that reads and writes one TLS connection in two threads loses one of twenty, on a busy machine."""
    for _ in range(100):
        with pytest.raises(TrialError, match="403"), open_stream(secured.base, "/live", {}, secured.trusting):
            pass


def test_a_connection_is_not_downgraded(secured: Secured) -> None:
    """Neither to an older TLS, nor to HTTP by a proxy that strips it."""
    old = ssl.create_default_context(cafile=str(secured.config / "rtstack" / "https" / "authority.pem"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        old.minimum_version, old.maximum_version = ssl.TLSVersion.TLSv1, ssl.TLSVersion.TLSv1_1
    with pytest.raises(httpx.ConnectError):
        httpx.get(secured.base, verify=old, trust_env=False)
    with secured.client() as client:
        stripped = {"origin": secured.base.replace("https", "http"), "x-forwarded-proto": "https"}
        assert client.post("/api/stop", headers=stripped).status_code == 403


def test_who_does_not_trust_the_authority_does_not_connect(secured: Secured) -> None:
    with pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"):
        httpx.get(secured.base, trust_env=False)


def test_what_is_not_https_gets_no_answer(secured: Secured) -> None:
    with socket.create_connection((HOST, secured.port), timeout=60.0) as plain:
        plain.sendall(f"GET / HTTP/1.1\r\nHost: {HOST}:{secured.port}\r\n\r\n".encode())
        assert plain.recv(1000) == b""


def test_it_answers_to_no_other_name(secured: Secured) -> None:
    with secured.client() as client:
        assert client.get("/", headers={"host": f"127.0.0.1:{secured.port}"}).status_code == 400
        assert client.get("/", headers={"host": f"rebound.example:{secured.port}"}).status_code == 400


@pytest.fixture
def authority(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Authority:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return Authority.of_user()


def test_the_authority_is_made_once(authority: Authority) -> None:
    assert Authority.of_user().fingerprint == authority.fingerprint
    assert re.fullmatch(r"SHA-256 ([0-9A-F]{2}:){31}[0-9A-F]{2}", authority.fingerprint)


def test_a_damaged_authority_is_one_line(authority: Authority) -> None:
    (authority.folder / "authority.key").write_text("none")
    with pytest.raises(ConfigurationError, match="is damaged: remove the folder"):
        Authority.of_user()


def test_the_authority_vouches_for_private_addresses_alone(authority: Authority) -> None:
    authority.check("192.168.7.3")
    with pytest.raises(ConfigurationError, match="no private address"):
        authority.serve("9.9.9.9")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--host", "192.168.1.5"], "give --https too"),
        (["--host", "0.0.0.0", "--https"], "not all of them"),
        (["--host", "lab", "--https"], "expected an IP address"),
        (["--host", "9.9.9.9", "--https"], "no private address"),
    ],
)
def test_a_host_that_cannot_be_is_one_line(options: list[str], words: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [str(COMMAND), "up", *options, "--logs", str(tmp_path / "logs")],
        capture_output=True, text=True, env={**os.environ, "XDG_CONFIG_HOME": str(tmp_path)},
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert words in done.stderr


@pytest.fixture
def sign_in(tmp_path: Path) -> Iterator[SignIn]:
    audit = AuditTrail(tmp_path / "audit.jsonl")
    yield SignIn(Address(8080), Tokens(tmp_path), audit, SessionFile(tmp_path))
    audit.close()


def test_a_code_works_once_and_the_newest_only(sign_in: SignIn) -> None:
    first, second = sign_in.pair(Scope.OPERATE), sign_in.pair(Scope.VIEW)
    assert re.fullmatch(rf"\d{{{CODE_DIGITS}}}", second)
    assert first == second or sign_in.redeem_code(first) is None
    session = sign_in.redeem_code(f"{second[:3]} {second[3:]}")
    assert session is not None
    assert session.scope is Scope.VIEW
    assert sign_in.redeem_code(second) is None


def test_a_code_cannot_be_guessed(sign_in: SignIn) -> None:
    code = sign_in.pair(Scope.OPERATE)
    wrong = f"{(int(code) + 1) % 10**CODE_DIGITS:0{CODE_DIGITS}d}"
    for _ in range(MAX_GUESSES):
        assert sign_in.redeem_code(wrong) is None
    assert sign_in.redeem_code(code) is None


def test_a_code_ends(sign_in: SignIn, monkeypatch: pytest.MonkeyPatch) -> None:
    code = sign_in.pair(Scope.OPERATE)
    now_s = console.sign_in._now_s()
    monkeypatch.setattr(console.sign_in, "_now_s", lambda: now_s + PAIRING_S + 1.0)
    assert sign_in.redeem_code(code) is None
