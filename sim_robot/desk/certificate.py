"""The self-signed certificate of a simulated box: made at each start, and the same one each time for one address.

Its key is derived from the address, so it is no secret: it is for addresses of this machine alone. A box that showed
another certificate each day would teach people to accept a changed one.
"""

import datetime
import hashlib
import ssl
import tempfile
from ipaddress import ip_address

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.x509.oid import NameOID

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
