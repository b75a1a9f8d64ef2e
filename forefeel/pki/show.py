"""What lies in a folder of certificates: whose, for which hosts, until when."""

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Literal

from cryptography import x509

from forefeel.common.errors import ConfigurationError
from forefeel.common.transport.pki import AUTHORITY, check_period, read_identity
from forefeel.pki.authority import AUTHORITY_NAME, hosts_of
from forefeel.pki.folder import find_members, read_certificate
from forefeel.pki.layout import Member

Colour = Literal["green", "amber", "red"]
AMBER_DAYS = 30  # days before the end from which it is amber; chosen, not measured: time to renew and copy


@dataclass(frozen=True, slots=True)
class CertificateRow:
    """One certificate. `advice` says what is wrong and what to do where it is not green."""

    file: str
    name: str
    hosts: tuple[str, ...]
    expires: str
    days_left: int
    colour: Colour
    advice: str


def rows(folder: Path, now: datetime) -> list[CertificateRow]:
    """The authority and everyone in the folder, of an authority's or of one host.

    Raises:
        ConfigurationError: no folder of certificates.
    """
    members = find_members(folder)
    authority = members[0].authority(folder)
    return [
        _authority_row(authority, read_certificate(authority), now),
        *(_row(folder, member, now) for member in members),
    ]


def _authority_row(path: Path, certificate: x509.Certificate, now: datetime) -> CertificateRow:
    try:
        check_period(path, certificate, now)
    except ConfigurationError as error:
        return _judged(AUTHORITY, AUTHORITY_NAME, certificate, now, str(error))
    return _judged(AUTHORITY, AUTHORITY_NAME, certificate, now, "")


def _row(folder: Path, member: Member, now: datetime) -> CertificateRow:
    path = member.certificate(folder)
    try:
        read_identity(path.parent, member.party, now)
        wrong = ""
    except ConfigurationError as error:
        wrong = str(error)
    name = str(path.relative_to(folder))
    return _judged(name, member.party.name, read_certificate(path), now, wrong)


def _judged(file: str, name: str, certificate: x509.Certificate, now: datetime, wrong: str) -> CertificateRow:
    end = certificate.not_valid_after_utc
    days_left = (end - now).days
    colour: Colour = "red" if wrong else "amber" if days_left < AMBER_DAYS else "green"
    advice = wrong or ("renew it soon: forefeel pki renew DIR" if colour == "amber" else "")
    return CertificateRow(
        file, name, hosts_of(certificate), f"{end:%Y-%m-%dT%H:%M:%SZ}", days_left, colour, advice
    )
