"""The certificates of a console that speaks HTTPS. A local authority, made once for a user, signs them.

A browser is told once to trust it. It can vouch for private addresses and localhost alone (RFC 5280, 4.2.1.10), so that
a stolen key opens no other site.
"""

import datetime
import os
import ssl
import tempfile
from dataclasses import dataclass
from ipaddress import ip_address, ip_network
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from hal.base.configuration import ConfigurationError
from hal.base.files import write_whole
from hal.base.shared import user_folder, user_name
from hal.desk.client import fingerprint

AUTHORITY_DAYS, CERTIFICATE_DAYS = 3650, 30  # the second one is made anew at each start
_PRIVATE = ("127.0.0.0/8", "10.0.0.0/8", "172.16.0.0/12", "192.168.0.0/16", "169.254.0.0/16")
_USAGES = (
    "digital_signature", "content_commitment", "key_encipherment", "data_encipherment", "key_agreement",
    "key_cert_sign", "crl_sign", "encipher_only", "decipher_only",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Authority:
    """certificate: a PEM file that a browser imports; key: for this user's eyes alone."""

    folder: Path

    @classmethod
    def of_user(cls) -> "Authority":
        """Return the authority in $XDG_CONFIG_HOME/rtstack/https, made if need be. Raises ConfigurationError."""
        authority = cls(_folder())
        try:
            if not authority.certificate.exists():
                authority._make()
            authority._signer()
        except OSError as error:
            raise ConfigurationError(f"the authority in {authority.folder} cannot be used: {error.strerror}") from None
        except (ValueError, TypeError):  # whatever the library makes of a damaged file
            todo = "remove the folder, and the next start makes a new one"
            raise ConfigurationError(f"the authority in {authority.folder} is damaged: {todo}") from None
        return authority

    @property
    def certificate(self) -> Path:
        """What a browser imports."""
        return self.folder / "authority.pem"

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the certificate, as browsers show it."""
        return fingerprint(self.certificate.read_text())

    @classmethod
    def trusting(cls) -> ssl.SSLContext:
        """Return what a program of this user connects with: the machine's authorities, and this one if it is there."""
        context, own = ssl.create_default_context(), cls(_folder()).certificate
        if own.is_file():
            context.load_verify_locations(own)
        return context

    def check(self, host: str) -> None:
        """Raise ConfigurationError where the authority may not vouch for an IP address."""
        if not any(ip_address(host) in ip_network(network) for network in _PRIVATE):
            todo = "put a proxy with a public certificate in front (docs/howto/https.md)"
            raise ConfigurationError(f"{host} is no private address: {todo}")

    def serve(self, host: str) -> ssl.SSLContext:
        """Return what a console at a private IP address shows itself with, signed now. Raises ConfigurationError."""
        self.check(host)
        key = ec.generate_private_key(ec.SECP256R1())
        names = [x509.IPAddress(ip_address(host)), *[x509.DNSName("localhost")] * ip_address(host).is_loopback]
        signer, issuer = self._signer()
        certificate = (
            _begun(_name(f"rtstack console at {host}"), issuer.subject, key.public_key(), CERTIFICATE_DAYS)
            .add_extension(x509.SubjectAlternativeName(names), critical=False)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
            .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key()), critical=False)
            .sign(signer, hashes.SHA256())
        )
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        with tempfile.NamedTemporaryFile() as file:  # the ssl module reads files only; of this user alone
            file.write(_pem(certificate) + _pem_of_key(key))
            file.flush()
            context.load_cert_chain(file.name)
        return context

    def _make(self) -> None:
        key = ec.generate_private_key(ec.SECP256R1())
        name = _name(f"rtstack authority of {user_name()} on {os.uname().nodename}")
        permitted = [x509.IPAddress(ip_network(network)) for network in _PRIVATE] + [x509.DNSName("localhost")]
        certificate = (
            _begun(name, name, key.public_key(), AUTHORITY_DAYS)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(x509.KeyUsage(**{each: each == "key_cert_sign" for each in _USAGES}), critical=True)
            .add_extension(x509.NameConstraints(permitted, None), critical=True)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
            .sign(key, hashes.SHA256())
        )
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        write_whole(self.folder / "authority.key", _pem_of_key(key).decode(), mode=0o600)
        write_whole(self.certificate, _pem(certificate).decode())

    def _signer(self) -> tuple[ec.EllipticCurvePrivateKey, x509.Certificate]:
        key = serialization.load_pem_private_key((self.folder / "authority.key").read_bytes(), None)
        if not isinstance(key, ec.EllipticCurvePrivateKey):
            raise ValueError("its key is of another kind")
        return key, x509.load_pem_x509_certificate(self.certificate.read_bytes())


def _folder() -> Path:
    return user_folder("XDG_CONFIG_HOME", ".config") / "https"


def _begun(subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, days: int) -> x509.CertificateBuilder:
    now, day = datetime.datetime.now(datetime.UTC), datetime.timedelta(days=1)
    builder = x509.CertificateBuilder().subject_name(subject).issuer_name(issuer).public_key(key)
    return (
        builder.serial_number(x509.random_serial_number()).not_valid_before(now - day).not_valid_after(now + days * day)
    )


def _name(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text[:64])])  # RFC 5280, ub-common-name


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _pem_of_key(key: ec.EllipticCurvePrivateKey) -> bytes:
    pkcs8, plain = serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    return key.private_bytes(serialization.Encoding.PEM, pkcs8, plain)
