"""Token and certificate by which pages and server trust each other, kept in the user's folder."""

import contextlib
import hmac
import ipaddress
import os
import secrets
import socket
import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from common.files import write_whole
from services.teleop.errors import TeleopError
from services.teleop.headset.config import EVERY_ADDRESS, HeadsetConfig

LIFE = timedelta(days=365)
"""Of a certificate."""
RENEWED_BEFORE = timedelta(days=30)
"""A certificate that ends within this time is made anew."""
_ALPHABET = "abcdefghjkmnpqrstuvwxyz23456789"
"""Without what looks alike, for a headset's user types it."""
_TOKEN_LENGTH = 12
"""Characters, 59 bits: too many to be tried over a network."""


@dataclass(frozen=True)
class Credentials:
    """What a server needs to be trusted.

    Attributes:
        token: every page must know it.
        names: host names and addresses of this machine, the best one for a link first.
        context: of TLS; None: plain HTTP.
        fingerprint: SHA-256 of the certificate as browsers show it; empty without one.
    """

    token: str
    names: tuple[str, ...]
    context: ssl.SSLContext | None = None
    fingerprint: str = ""

    def admits(self, token: str) -> bool:
        """Return whether ``token`` is the right one, in a time that does not tell how wrong."""
        return hmac.compare_digest(token.encode(), self.token.encode())


def prepare(config: HeadsetConfig, *, new_token: bool = False) -> Credentials:
    """Return the credentials of the user's folder, made now where they are missing.

    Args:
        config: says where and for which addresses.
        new_token: make a new token, so that links given out before no longer open the page.

    Raises:
        TeleopError: the folder cannot be read or written.
    """
    folder, names = config.data_folder, own_names(config)
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        token = _token(folder / "token", new=new_token)
        if not config.secure:
            return Credentials(token, names)
        certificate = _certificate(folder, names)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.load_cert_chain(folder / "certificate.pem", folder / "key.pem")
    except (OSError, ssl.SSLError) as error:
        raise TeleopError(
            f"cannot use the folder of certificate and token {folder}: {error}; make it writable, "
            "or choose another one by [headset] folder"
        ) from error
    digest = certificate.fingerprint(hashes.SHA256()).hex(":").upper()
    return Credentials(token, names, context, digest)


def own_names(config: HeadsetConfig) -> tuple[str, ...]:
    """Return the names and addresses by which browsers may reach the page, the best one first."""
    if not config.secure:
        found = [config.address, "localhost", "127.0.0.1"]
    else:
        host = socket.gethostname()
        wanted = [] if config.address == EVERY_ADDRESS else [config.address]
        found = [*wanted, *_own_addresses(host), host, f"{host}.local", "localhost", "127.0.0.1"]
    return tuple(dict.fromkeys([*config.names, *found]))


def _own_addresses(host: str) -> list[str]:
    """Return this machine's addresses in the network: first that of the default route."""
    addresses = []
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        # Nothing is sent: connecting a datagram socket only looks the route up. The address is
        # one for documentation (RFC 5737).
        probe.connect(("192.0.2.1", 9))
        addresses.append(str(probe.getsockname()[0]))
    with contextlib.suppress(OSError):
        addresses += [str(info[4][0]) for info in socket.getaddrinfo(host, None, socket.AF_INET)]
    return [address for address in addresses if not ipaddress.ip_address(address).is_loopback]


def _token(path: Path, *, new: bool) -> str:
    if not new and path.exists():
        token = path.read_text(encoding="utf-8").strip()
        if len(token) >= _TOKEN_LENGTH and token.isascii() and token.isalnum():
            return token
    token = "".join(secrets.choice(_ALPHABET) for _ in range(_TOKEN_LENGTH))
    _write_private(path, token.encode() + b"\n")
    return token


def _certificate(folder: Path, names: Sequence[str]) -> x509.Certificate:
    """Return a certificate for ``names``: the one there, or a new one if that does not do."""
    path, key_path = folder / "certificate.pem", folder / "key.pem"
    with contextlib.suppress(FileNotFoundError, ValueError):
        certificate = x509.load_pem_x509_certificate(path.read_bytes())
        left = certificate.not_valid_after_utc - datetime.now(UTC)
        if key_path.exists() and left > RENEWED_BEFORE and set(names) <= _names_in(certificate):
            return certificate
    key = ec.generate_private_key(ec.SECP256R1())
    certificate = _signed(key, names)
    _write_private(
        key_path,
        key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        ),
    )
    write_whole(path, certificate.public_bytes(serialization.Encoding.PEM))
    return certificate


def _signed(key: ec.EllipticCurvePrivateKey, names: Sequence[str]) -> x509.Certificate:
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "trill headset")])
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        # An hour ago, for clocks of headsets that go wrong a little.
        .not_valid_before(now - timedelta(hours=1))
        .not_valid_after(now + LIFE)
        .add_extension(x509.SubjectAlternativeName([_general(name) for name in names]), False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), True)
        .add_extension(x509.ExtendedKeyUsage([x509.OID_SERVER_AUTH]), False)
        .sign(key, hashes.SHA256())
    )


def _general(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        return x509.DNSName(name)


def _names_in(certificate: x509.Certificate) -> set[str]:
    """Return the names and addresses of a certificate.

    Raises:
        ValueError: it has none.
    """
    try:
        extension = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName)
    except x509.ExtensionNotFound as error:
        raise ValueError("the certificate names no host") from error
    return {str(name.value) for name in extension.value}


def _write_private(path: Path, content: bytes) -> None:
    """Write a file that only its owner may read, whole or not at all."""
    # The mask holds for the temporary file too, from its first byte on.
    before = os.umask(0o077)
    try:
        write_whole(path, content)
    finally:
        os.umask(before)
