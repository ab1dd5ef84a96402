"""A client of one box's Desk: reading needs no sign-in, changing needs user, password and control.

Paths, headers and codes are those of published clients (see the package). A request that changes something is never
repeated by itself. A box's certificate is self-signed: at first use it is written to a file of the user's, and its
fingerprint is said; from then on another one is refused, before user and password are sent.
"""

import hashlib
import json
import socket
import ssl
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Timer
from typing import Any

import httpx

from hal.base.files import write_whole
from hal.base.shared import user_folder
from hal.desk.state import DeskState, owner_of, plain, state_of
from hal.errors import HardwareError

HTTPS = 443
_NO_CHECK_TIME = 0x200000  # X509_V_FLAG_NO_CHECK_TIME (openssl/x509_vfy.h): a box's clock may be anywhere
_TIMEOUT_S = 3.0


class NotTrusted(HardwareError):
    """A box whose certificate is not the one that was remembered, or of which none was. The message says what to do."""


def host_and_port(address: str) -> tuple[str, int]:
    """Return the parts of HOST or HOST:PORT. Raises ValueError."""
    host, colon, port = address.partition(":")
    if not host or (colon and not (port.isdecimal() and 0 < int(port[:6]) < 1 << 16)):
        raise ValueError(f"{address!r}: expected HOST or HOST:PORT")
    return host, int(port) if colon else HTTPS


class Trust:
    """The certificates that a user has seen: one PEM file a box, in the folder of the user's configuration."""

    def __init__(self, folder: Path | None = None) -> None:
        """folder: by default $XDG_CONFIG_HOME/rtstack/desk, or that of ~/.config. Raises ConfigurationError."""
        self.folder = folder or user_folder("XDG_CONFIG_HOME", ".config") / "desk"

    def file(self, address: str) -> Path:
        return self.folder / f"{address}.pem"

    def knows(self, address: str) -> bool:
        return self.file(address).is_file()

    def remember(self, address: str) -> str:
        """Remember the certificate that the box shows now; return its fingerprint. Raises OSError."""
        context = ssl.create_default_context()
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        with (
            socket.create_connection(host_and_port(address), _TIMEOUT_S) as line, line.dup() as same,
            _within(_TIMEOUT_S, [same]), context.wrap_socket(line) as encrypted,
        ):  # fmt: skip
            pem = ssl.DER_cert_to_PEM_cert(encrypted.getpeercert(binary_form=True) or b"")
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_whole(self.file(address), pem, mode=0o600)
        return fingerprint(pem)

    def context(self, address: str) -> ssl.SSLContext:
        """Return what connects to this box's certificate and to no other one. Raises NotTrusted."""
        if not self.knows(address):
            raise NotTrusted(f"Desk at {address} was not used before: run `rtstack desk status` once as this user")
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname = False  # boxes are reached by addresses that their certificates do not have
        context.verify_flags |= ssl.VerifyFlags(_NO_CHECK_TIME) | ssl.VerifyFlags.VERIFY_X509_PARTIAL_CHAIN
        try:
            context.load_verify_locations(self.file(address))
        except (ssl.SSLError, OSError):
            raise NotTrusted(f"{self.file(address)} is no certificate: remove the file") from None
        return context

    def changed(self, address: str) -> NotTrusted:
        """Return what to raise where the box shows another certificate."""
        known = fingerprint(self.file(address).read_text())
        return NotTrusted(
            f"Desk at {address} shows another certificate than before (it was {known}): nothing was sent. Was the box "
            f"replaced or reset? Then remove {self.file(address)}; else another machine answers at its address"
        )


def fingerprint(pem: str) -> str:
    """Return SHA-256 of a certificate, as browsers show it."""
    digest = hashlib.sha256(ssl.PEM_cert_to_DER_cert(pem)).hexdigest().upper()
    return "SHA-256 " + ":".join(digest[k : k + 2] for k in range(0, len(digest), 2))


@contextmanager
def _within(seconds: float, lines: Sequence[socket.socket]) -> Iterator[None]:
    """Return a context that hangs up after so long: a server that sends a byte now and then ends no read by itself."""
    timer = Timer(seconds, _hang_up, (lines,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _hang_up(lines: Sequence[socket.socket]) -> None:
    for line in lines:
        with suppress(OSError):
            line.shutdown(socket.SHUT_RDWR)


_ANSWER_S = 5.0
_MOST_BYTES = 1 << 20  # of an answer, unpacked: a box's have some hundreds
_TOO_LONG = f"its answer is longer than {_MOST_BYTES} bytes"
_GZIP = 16 + zlib.MAX_WBITS
_SLOW_S = 600.0  # brakes take seconds, the self-test minutes
_CONTROL = "/api/system/control-token"
_ADVICE = {
    "BrakesClosed": "unlock the joints first",
    "EmergencyStopPressed": "its stop is pressed: release it first",
    "SelfTestsElapsed": "its self-test is overdue: rtstack desk start --self-test",
    "FciActive": "FCI is active: rtstack desk stop first",
}


class DeskError(HardwareError):
    """Desk does not answer, or refuses. The message names the box and says what to do. code: the interface's."""

    def __init__(self, message: str, status: int = 0, code: str = "") -> None:
        super().__init__(message)
        self.status, self.code = status, code


@dataclass(frozen=True, slots=True)
class SignIn:
    user: str
    password: str = field(repr=False)


@dataclass(frozen=True, slots=True)
class Control:
    """Control on a Desk: the secret that goes with each change, and its number, which the box shows."""

    token: str = field(repr=False)
    number: int | None


def _change(path: str, slow_s: float = 0.0, **body: str) -> "Callable[[Desk], None]":
    """Return a method that has the box change something."""
    return lambda desk: desk._tell(path, body, slow_s)


class Desk:
    """Desk of the box at HOST[:PORT]; close it. control: what `take_control` gave, or what was kept from before."""

    def __init__(self, address: str, trust: Trust, sign_in: SignIn | None = None, name: str = "box") -> None:
        """Connects with the first request. name: in messages, as "left box". Raises NotTrusted, DeskError."""
        self.called = f"Desk of the {name} at {address}"
        self.control: Control | None = None
        self._address, self._trust, self._owner = address, trust, "rtstack"
        try:
            host, port = host_and_port(address)
        except ValueError as error:
            raise DeskError(f"{self.called}: {error}") from None
        self._client = httpx.Client(
            base_url=f"https://{host}" + (f":{port}" if port != HTTPS else ""),
            verify=trust.context(address),
            auth=(sign_in.user, sign_in.password) if sign_in else None,
            headers={"accept-encoding": "gzip"},
            trust_env=False,  # no proxy, no other certificates
        )
        self._lines: list[socket.socket] = []  # the connection once more, to hang up on it
        self._version: Any = None

    def close(self) -> None:
        """Disconnect. Never raises."""
        self._client.close()
        self._close_lines()

    def _close_lines(self) -> None:
        while self._lines:
            self._lines.pop().close()

    def state(self) -> DeskState:
        """Return what the box says of itself. Changes nothing, and needs no control. Raises DeskError, NotTrusted."""
        system = self._read("/api/system")
        if self._version is None:
            self._version = self._read("/admin/api/system-version", optional=True)
        joints, fci, control = (self._read(path) for path in ("/api/arm/joints", "/api/fci", _CONTROL))
        tests, recovery = (self._read(f"/api/safety/{name}", optional=True) for name in ("self-tests", "recovery"))
        return state_of(system, joints, fci, control, tests, recovery, self._version)

    def take_control(self, wait_s: float = 1.0) -> Control:
        """Take control, where it is free, or as soon as its owner gives it back. Raises DeskError."""
        try:
            answer = self._tell("/api/system/control-token:take", {"owner": self._owner, "timeout": wait_s}, wait_s)
        except DeskError as error:
            if error.code != "Timeout":
                raise
            owner = owner_of(self._read(_CONTROL))
            raise DeskError(
                f"{self.called}: control is with {owner or 'another program'}: give it back there, or take it over on "
                "the Desk page, which asks for a button at the arm",
                error.status, error.code,
            ) from None  # fmt: skip
        token, number = (answer.get("token"), answer.get("tokenId")) if isinstance(answer, dict) else (None, None)
        if not isinstance(token, str) or not (token.isascii() and token.isprintable()):
            raise DeskError(f"{self.called}: it gave no control token; is its system older than 5.9?")
        self.control = Control(token, number if isinstance(number, int) else None)
        return self.control

    def has_control(self) -> bool:
        """Return whether `control` still counts. Raises DeskError, NotTrusted."""
        answer = self._read(_CONTROL)
        number = answer.get("tokenId") if isinstance(answer, dict) else None
        return self.control is not None and number is not None and number == self.control.number

    def release_control(self) -> None:
        self._tell("/api/system/control-token:release")
        self.control = None

    # each of them raises DeskError: open the brakes, so that the arm stands under its own control; close them; change
    # to the mode in which FCI may move the arm; let FCI in, and in no more, which ends a motion; run the safety
    # self-test, which takes minutes, and power and brakes of the arm go off and on; shut the box down
    unlock = _change("/api/arm/joints:unlock", _SLOW_S)
    lock = _change("/api/arm/joints:lock", _SLOW_S)
    execution = _change("/api/system/operating-mode:change", desiredOperatingMode="Execution")
    activate_fci = _change("/api/fci:activate", _SLOW_S)
    deactivate_fci = _change("/api/fci:deactivate", _SLOW_S)
    self_test = _change("/api/safety/self-tests:execute", _SLOW_S)
    shut_down = _change("/api/system:shutdown")

    def _read(self, path: str, optional: bool = False) -> Any:
        return self._request("GET", path, missing=(401, 403, 404) if optional else ())

    def _tell(self, path: str, body: dict[str, Any] | None = None, slow_s: float = 0.0) -> Any:
        headers = {"X-Control-Token": self.control.token} if self.control else {}
        return self._request("POST", path, slow_s, json=body or {}, headers=headers)

    def _connected(self, event: str, found: Mapping[str, Any]) -> None:
        """Called by httpcore at each of its steps."""
        if event == "connection.connect_tcp.complete":
            self._close_lines()  # of one that the box has ended
            self._lines.append(found["return_value"].get_extra_info("socket").dup())

    def _request(self, method: str, path: str, slow_s: float = 0.0, missing: Sequence[int] = (), **more: Any) -> Any:
        """Return what a whole answer has, of at most _MOST_BYTES, within _ANSWER_S + slow_s: JSON, text, None for
        nothing or for a status in `missing`. Raises DeskError, NotTrusted."""
        more |= {"timeout": httpx.Timeout(_ANSWER_S, read=_ANSWER_S + slow_s), "extensions": {"trace": self._connected}}
        try:
            with _within(_ANSWER_S + slow_s, self._lines), self._client.stream(method, path, **more) as answer:
                body = b""
                for part in answer.iter_raw():
                    body += part
                    if len(body) > _MOST_BYTES:
                        raise httpx.DecodingError(_TOO_LONG)
                if answer.headers.get("content-encoding", "identity") != "identity":
                    body = zlib.decompressobj(_GZIP).decompress(body, _MOST_BYTES + 1)
                    if len(body) > _MOST_BYTES:
                        raise httpx.DecodingError(_TOO_LONG)
                status, reason = answer.status_code, answer.reason_phrase
        except (httpx.HTTPError, zlib.error) as error:
            _hang_up(self._lines)
            self._close_lines()
            cause: BaseException | None = error
            while cause is not None:
                if isinstance(cause, ssl.SSLCertVerificationError):
                    raise self._trust.changed(self._address) from None
                cause = cause.__cause__ or cause.__context__
            why = plain(str(error), 400) or type(error).__name__
            raise DeskError(f"{self.called} does not answer: {why}; is the box on, and the address right?") from None
        try:
            value = json.loads(body) if body else None
        except (ValueError, RecursionError):
            value = body.decode(errors="replace")
        if 200 <= status < 300:
            return value
        if status in missing:
            return None
        if status == 401:
            raise DeskError(f"{self.called}: user or password is wrong, or missing", 401)
        words = value if isinstance(value, dict) else {}
        details = [plain(str(one)) for one in words["details"][:8]] if isinstance(words.get("details"), list) else []
        code, message = plain(str(words.get("code") or "")), str(words.get("message") or reason)
        advice = [_ADVICE[one] for one in details if one in _ADVICE]
        what = f"{', '.join(details) or code or status}: {message}"
        if status == 423:
            advice.append("control has gone to another program, or the box was restarted: try again")
        text = plain(f"{self.called} refuses ({what})", 400)
        raise DeskError(text + "".join(f"; {one}" for one in advice), status, code)
