"""HTTPS in front of a DeskBox: paths, sign-in and codes. One thread a connection; nothing here is in real time.

python -m sim_robot.desk.server FLAGS_DESCRIPTOR PORT SELF_TEST_DUE_S SIDE=ADDRESS...    in the order of the flags
"""

import base64
import datetime
import hashlib
import json
import secrets
import ssl
import sys
import tempfile
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from ipaddress import ip_address
from socket import socket
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.x509.oid import NameOID

from sim_robot.desk.box import DeskBox, Refused
from sim_robot.desk.process import flags_at

USER, PASSWORD = "franka", "simulated"
VERSION = "5.9.2"  # the first line of three; the others are digests
_LARGEST_BODY = 65_536
_SILENT_S = 30.0
# what needs no sign-in: franka-deskapi asks for these without a sign-in
_READ: dict[str, Callable[[DeskBox], Any]] = {
    "/api/system": DeskBox.system,
    "/api/system/operating-mode": DeskBox.operating_mode,
    "/api/system/control-token": DeskBox.control_token,
    "/api/arm/joints": DeskBox.joints,
    "/api/fci": DeskBox.fci,
    "/api/safety/self-tests": DeskBox.self_tests,
    "/api/safety/recovery": DeskBox.recovery,
    "/admin/api/system-version": lambda box: f"{VERSION}\n{'0' * 40}\n{'0' * 40}",
}
_FROM, _UNTIL = datetime.datetime(2025, 1, 1), datetime.datetime(2125, 1, 1)


def server_context(address: str) -> ssl.SSLContext:
    """Return what a box at this IP address shows itself with."""
    key = Ed25519PrivateKey.from_private_bytes(hashlib.sha256(f"simulated Desk {address}".encode()).digest())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"simulated control box {address}")])
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(_FROM)
        .not_valid_after(_UNTIL)
        .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ip_address(address))]), critical=False)
        .sign(key, None)  # Ed25519 brings its own digest, and signs the same way each time
    )
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    with tempfile.NamedTemporaryFile() as file:  # the ssl module reads files only
        file.write(certificate.public_bytes(serialization.Encoding.PEM))
        pkcs8, plain = serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        file.write(key.private_bytes(serialization.Encoding.PEM, pkcs8, plain))
        file.flush()
        context.load_cert_chain(file.name)
    return context


def _seconds(value: Any) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0.0:
        raise Refused(400, "InvalidArgument", "timeout is a number above 0, s")
    return float(value)


# A route's function takes the box and the request's body.
_TOLD: dict[str, Callable[[DeskBox, dict[str, Any]], Any]] = {
    "/api/system/control-token:take": lambda box, body: box.take_control(
        str(body.get("owner") or USER), _seconds(body.get("timeout"))
    ),
    "/api/system/control-token:release": lambda box, body: box.release_control(),
    "/api/system/operating-mode:change": lambda box, body: box.change_mode(str(body.get("desiredOperatingMode"))),
    "/api/arm/joints:unlock": lambda box, body: box.unlock(),
    "/api/arm/joints:lock": lambda box, body: box.lock(),
    "/api/fci:activate": lambda box, body: box.activate_fci(),
    "/api/fci:deactivate": lambda box, body: box.deactivate_fci(),
    "/api/safety/self-tests:execute": lambda box, body: box.execute_self_tests(),
    "/api/safety/recovery:confirm": lambda box, body: box.confirm_recovery(str(body.get("type"))),
    "/api/system:shutdown": lambda box, body: box.shut_down(),
}
# what a user who is signed in may do without control
_WITHOUT_CONTROL = ("/api/system/control-token:take", "/api/arm/joints:lock", "/api/system:shutdown")


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "Desk", "(simulated)"
    timeout = _SILENT_S
    server: "DeskServer"  # pyright: ignore[reportIncompatibleVariableOverride]  # the one that makes it

    def do_GET(self) -> None:
        self._serve(self._read)

    def do_POST(self) -> None:
        self._serve(self._tell)

    def _serve(self, answer: Callable[[], Any]) -> None:
        try:
            content = answer()
        except Refused as refusal:
            words = {"code": refusal.code, "message": str(refusal), "details": list(refusal.details)}
            self._send(refusal.status, words)
        else:
            self._send(204 if content is None else 200, content)

    def _read(self) -> Any:
        self._sign_in(needed=False)
        return self._found(_READ)(self.server.box)

    def _tell(self) -> Any:
        length = self.headers.get("Content-Length", "0")
        if not length.isdecimal() or int(length) > _LARGEST_BODY:
            self.close_connection = True
            raise Refused(413, "TooLarge", "the request is too large")
        text = self.rfile.read(int(length))
        self._sign_in(needed=True)
        told = self._found(_TOLD)
        try:
            body = json.loads(text or b"{}")
        except (ValueError, RecursionError):
            body = None
        if not isinstance(body, dict):
            raise Refused(400, "InvalidArgument", "the body is no JSON object")
        if self._path not in _WITHOUT_CONTROL:
            self.server.box.check(self.headers.get("X-Control-Token"))
        return told(self.server.box, body)

    @property
    def _path(self) -> str:
        return self.path.partition("?")[0]

    def _found(self, routes: dict[str, Any]) -> Any:
        if self.server.box.off:
            self.close_connection = True
            raise Refused(503, "ShuttingDown", "the box was shut down")
        route = routes.get(self._path)
        if route is None:
            raise Refused(404, "NotFound", "there is no such path")
        return route

    def _sign_in(self, needed: bool) -> None:
        given = self.headers.get("Authorization")
        if given is None and not needed:
            return
        scheme, _, words = (given or "").partition(" ")
        known = base64.b64encode(f"{USER}:{PASSWORD}".encode())
        if scheme.lower() != "basic" or not secrets.compare_digest(words.encode(), known):
            raise Refused(401, "Unauthorized", "user or password is wrong")

    def _send(self, status: int, content: Any) -> None:
        body = b"" if content is None else json.dumps(content).encode()
        self.send_response(status)
        if body:
            self.send_header("Content-Type", "application/json;charset=utf-8")
        if status != 204:
            self.send_header("Content-Length", str(len(body)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


class DeskServer(ThreadingHTTPServer):
    """Desk of one box, at an IP address of this machine and a port."""

    daemon_threads = True

    def __init__(self, address: str, port: int, box: DeskBox) -> None:
        self.box = box
        self._context = server_context(address)
        super().__init__((address, port), _Handler)

    def get_request(self) -> tuple[socket, Any]:
        """Return a connection whose handshake its own thread makes: one that is silent holds no other one up."""
        connection, peer = super().get_request()
        connection.settimeout(_SILENT_S)
        return self._context.wrap_socket(connection, server_side=True, do_handshake_on_connect=False), peer

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a client that hung up, or did not want this certificate."""

    def finish_request(self, request: Any, client_address: Any) -> None:
        if isinstance(request, ssl.SSLSocket):
            request.do_handshake()
        super().finish_request(request, client_address)


def main() -> int:
    """Serve until standard input ends. Returns 2 where it cannot listen."""
    descriptor, port, self_test_due_s, *boxes = sys.argv[1:]
    flags = flags_at(int(descriptor))
    for number, named in enumerate(boxes):
        side, _, address = named.partition("=")
        box = DeskBox(flags[number], f"simulated-{side}", float(self_test_due_s))
        try:
            server = DeskServer(address, int(port), box)
        except OSError as error:
            print(f"Desk cannot listen at {address}:{port}: {error.strerror}", flush=True)
            return 2
        threading.Thread(target=server.serve_forever, daemon=True).start()
    print("serving", flush=True)
    sys.stdin.read()
    return 0


if __name__ == "__main__":
    sys.exit(main())
