"""Reads the certificates of a party, and says what is wrong with them, which Zenoh would not.

`forefeel.pki` makes such a folder.
"""

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from forefeel.common.errors import ConfigurationError
from forefeel.common.transport.security import Party, PartyFiles

if TYPE_CHECKING:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.types import PrivateKeyTypes

AUTHORITY = "ca.crt"
_MADE = "a copy of DIR/CELL/ROLE of `forefeel pki init DIR`"


@dataclass(frozen=True, slots=True)
class Certified:
    """Files of a party that belong together and are valid now; `expires`: when the first certificate ends."""

    identity: PartyFiles
    expires: datetime


def read_identity(folder: Path, party: Party, now: datetime) -> Certified:
    """Reads and checks the files of the party in a folder of `forefeel pki init`; returns their paths and the
    earlier expiry of its certificate and the authority's.

    Raises:
        ConfigurationError: one is missing, unreadable, of another party or authority, not valid at `now`, or
            a key that every user may use.
    """
    if not folder.is_dir():
        raise _wrong(folder, "no such folder", _MADE)
    files = PartyFiles(folder / AUTHORITY, folder / f"{party.role}.crt", folder / f"{party.role}.key")
    authority, certificate = (read_certificate(Path(path)) for path in (files.authority, files.certificate))
    key_file = Path(files.key)
    key = _read_key(key_file)
    _check_name(Path(files.certificate), certificate, party)
    if certificate.public_key() != key.public_key():
        raise _wrong(key_file, f"does not belong to {party.role}.crt", "both of one forefeel pki init")
    if not _issued(certificate, authority):
        raise _wrong(Path(files.certificate), "not signed by ca.crt", "both of one forefeel pki init")
    check_period(Path(files.authority), authority, now)
    check_period(Path(files.certificate), certificate, now)
    return Certified(files, min(authority.not_valid_after_utc, certificate.not_valid_after_utc))


def read_certificate(path: Path) -> "x509.Certificate":
    """Reads a PEM certificate.

    Raises:
        ConfigurationError: missing, unreadable, or not a certificate.
    """
    from cryptography import x509  # noqa: PLC0415 - most sessions are on loopback and need none

    try:
        return x509.load_pem_x509_certificate(_read(path))
    except ValueError as error:
        raise _wrong(path, "no certificate", f"PEM, {_MADE}") from error


def check_period(path: Path, certificate: "x509.Certificate", now: datetime) -> None:
    """Raises ConfigurationError where the certificate has expired at `now`, or is not valid yet."""
    start, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if now > end:
        raise _wrong(path, f"expired on {end:%Y-%m-%d %H:%M} UTC", renewal(path))
    if now < start:
        raise _wrong(
            path, f"valid from {start:%Y-%m-%d %H:%M} UTC only", "the clock of this host to be right"
        )


def renewal(path: Path) -> str:
    """Text on what replaces a certificate that has expired, or ends soon."""
    if path.name == AUTHORITY:
        return "a new authority: `forefeel pki init` with a new DIR, its folders copied to every host"
    return "a new one: `forefeel pki init DIR` where ca.key is kept, then copy it"


def _check_name(path: Path, certificate: "x509.Certificate", party: Party) -> None:
    names = [str(part.value) for part in certificate.subject if part.oid.dotted_string == "2.5.4.3"]
    if names != [party.name]:
        actual = ", ".join(names) or "no name"
        raise _wrong(path, f"made for {actual}", f"{party.name}, the {party.role}'s of this cell")


def _issued(certificate: "x509.Certificate", authority: "x509.Certificate") -> bool:
    """True if the authority signed the certificate."""
    from cryptography.exceptions import InvalidSignature  # noqa: PLC0415

    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature):
        return False
    return True


def _read_key(path: Path) -> "PrivateKeyTypes":
    """The private key in a file; raises ConfigurationError where it is none, has a password, or every user of
    the host may use the file.
    """
    from cryptography.hazmat.primitives.serialization import load_pem_private_key  # noqa: PLC0415

    data = _read(path)
    if path.stat().st_mode & 0o007:
        raise _wrong(
            path, "a private key that every user of this host may use", f"mode 0600: chmod 600 {path}"
        )
    try:
        return load_pem_private_key(data, None)
    except (ValueError, TypeError) as error:  # not PEM; encrypted
        raise _wrong(path, "no private key", f"PEM without password, {_MADE}") from error


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise _wrong(path, error.strerror or "unreadable", _MADE) from error


def _wrong(path: Path, problem: str, expected: str) -> ConfigurationError:
    return ConfigurationError(f"{path}: {problem}; expected {expected}")
