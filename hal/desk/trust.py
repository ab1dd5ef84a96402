"""Which certificate a box has: it is self-signed, so no authority vouches for it; it is remembered at first use.

Where a person uses a box for the first time, its certificate is written to a file of the user's, and its fingerprint
is said. From then on a connection to another certificate is refused, before user and password are sent.
"""

import hashlib
import os
import ssl
from pathlib import Path

from hal.errors import HardwareError
from hal.files import write_whole

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
        """folder: by default $XDG_CONFIG_HOME/rtstack/desk, or that of ~/.config."""
        base = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
        self.folder = folder or Path(base).expanduser() / "rtstack" / "desk"

    def file(self, address: str) -> Path:
        """Return where the certificate of the box at HOST[:PORT] is kept."""
        return self.folder / f"{address}.pem"

    def knows(self, address: str) -> bool:
        """Return whether the box was used before."""
        return self.file(address).is_file()

    def remember(self, address: str) -> str:
        """Remember the certificate that the box shows now; return its fingerprint. Raises OSError."""
        pem = ssl.get_server_certificate(host_and_port(address), timeout=_TIMEOUT_S)
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
