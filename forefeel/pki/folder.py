"""A folder of certificates: made whole or not at all, read back, renewed, handed out."""

import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from functools import partial
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.transport.pki import AUTHORITY
from forefeel.common.transport.security import Party
from forefeel.interrupt import at_last
from forefeel.pki.authority import Authority, certificate_pem, hosts_of, key_pem, new_key
from forefeel.pki.layout import AUTHORITY_KEY, Member, members_of, party_named

# modes of a key, a certificate and a folder (chmod(2)): keys for the owner only
_SECRET, _PUBLIC, _FOLDER = 0o600, 0o644, 0o700


def make_folder(
    folder: Path, cells: Sequence[str], hosts: Mapping[str, Sequence[str]], days: int, now: datetime
) -> list[Member]:
    """A new authority and a certificate for everyone, in a folder that is there whole or not at all.

    Args:
        folder: new, or empty.
        cells: one: its roles lie in the folder itself; several: each in a folder of its name.
        hosts: names and addresses by the member's word.
        days: how long the roles' certificates are valid.
        now: the calendar's time.

    Raises:
        ConfigurationError: the folder holds something. RunError: it can not be written.
    """
    members = members_of(cells, apart=len(cells) > 1)
    authority = Authority.new(now)
    with _new_folder(folder) as part:
        _write(part / AUTHORITY_KEY, key_pem(authority.key), _SECRET)
        _write(part / AUTHORITY, certificate_pem(authority.certificate), _PUBLIC)
        for member in members:
            _issue(part, authority, member, hosts.get(member.word, ()), days, now)
    return members


def add_cell(
    folder: Path, cell: str, hosts: Mapping[str, Sequence[str]], days: int, now: datetime
) -> list[Member]:
    """One more cell under the same authority, in a folder of its name.

    Raises:
        ConfigurationError: there is such a cell, or no authority's key. RunError: it can not be written.
    """
    authority = read_authority(folder)
    if cell in cells_of(find_members(folder)) or (folder / cell).exists():
        raise ConfigurationError(f"{folder}: has a cell {cell}; expected a new name")
    members = [each for each in members_of([cell], apart=True) if each.part]
    with _new_folder(folder / cell) as part:
        for member in members:
            flat = Member(member.party)
            _issue(part, authority, flat, hosts.get(member.word, ()), days, now)
    return members


def renew(
    folder: Path,
    members: Sequence[Member],
    hosts: Mapping[str, Sequence[str]],
    days: int,
    now: datetime,
) -> None:
    """New certificates for the same keys, each file replaced at once; hosts that are not given stay.

    Raises:
        ConfigurationError: no authority's key, or a certificate that can not be read. RunError: see above.
    """
    authority = read_authority(folder)
    if now >= authority.certificate.not_valid_after_utc:
        raise ConfigurationError(
            f"{folder / AUTHORITY}: expired; expected a new authority: forefeel pki init in a new folder"
        )
    for member in members:
        path = member.certificate(folder)
        old = read_certificate(path)
        public = old.public_key()
        if not isinstance(public, ec.EllipticCurvePublicKey):
            raise ConfigurationError(f"{path}: not on an elliptic curve; expected one of forefeel pki init")
        kept = hosts.get(member.word, hosts_of(old))
        new = authority.sign(member.party.name, public, kept, now, days)
        _replace(path, certificate_pem(new))


def bundle(folder: Path, member: Member, out: Path) -> list[str]:
    """What the member's host needs, and nothing else, in a new folder; the names of the files.

    Raises:
        ConfigurationError: a file is missing, or `out` holds something. RunError: it can not be written.
    """
    files = [member.authority(folder), member.certificate(folder), member.key(folder)]
    contents = [_read(path) for path in files]
    with _new_folder(out) as part:
        for path, content in zip(files, contents, strict=True):
            _write(part / path.name, content, _SECRET if path.suffix == ".key" else _PUBLIC)
    return [path.name for path in files]


def find_members(folder: Path) -> list[Member]:
    """Whose certificates lie there, the router's last.

    Raises:
        ConfigurationError: no folder, or none of ours.
    """
    paths = sorted([*folder.glob("*.crt"), *folder.glob("*/*.crt")])
    named = [(path, party_named(_common_name(path))) for path in paths if path.name != AUTHORITY]
    cells = tuple(dict.fromkeys(who[1] for _, who in named if who is not None and who[1]))
    found = [
        Member(
            Party(who[0], (who[1],) if who[1] else cells), "" if path.parent == folder else path.parent.name
        )
        for path, who in named
        if who is not None
    ]
    if not found:
        raise ConfigurationError(f"{folder}: no certificates; expected a folder of forefeel pki init")
    return sorted(found, key=lambda member: member.party.role == "router")


def cells_of(members: Sequence[Member]) -> list[str]:
    """The cells, each once."""
    return list(dict.fromkeys(cell for member in members for cell in member.party.cells))


def read_authority(folder: Path) -> Authority:
    """The authority with the key that signs.

    Raises:
        ConfigurationError: one of the two is missing or does not belong to the other.
    """
    path = folder / AUTHORITY_KEY
    try:
        key = load_pem_private_key(_read(path), None)
    except (ValueError, TypeError) as error:
        raise ConfigurationError(f"{path}: no private key; expected the one of forefeel pki init") from error
    certificate = read_certificate(folder / AUTHORITY)
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
        raise ConfigurationError(
            f"{path}: does not belong to {AUTHORITY}; expected both of one forefeel pki init"
        )
    return Authority(certificate, key)


def read_certificate(path: Path) -> x509.Certificate:
    """A PEM certificate.

    Raises:
        ConfigurationError: missing, or none.
    """
    try:
        return x509.load_pem_x509_certificate(_read(path))
    except ValueError as error:
        raise ConfigurationError(f"{path}: no certificate; expected PEM") from error


def _common_name(path: Path) -> str:
    names = read_certificate(path).subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
    return str(names[0].value) if names else ""


def _issue(
    part: Path, authority: Authority, member: Member, hosts: Sequence[str], days: int, now: datetime
) -> None:
    inside = part / member.part
    if not inside.exists():
        inside.mkdir(mode=_FOLDER)
    if not (inside / AUTHORITY).exists():
        _write(inside / AUTHORITY, certificate_pem(authority.certificate), _PUBLIC)
    key = new_key()
    certificate = authority.sign(member.party.name, key.public_key(), hosts, now, days)
    _write(member.key(part), key_pem(key), _SECRET)
    _write(member.certificate(part), certificate_pem(certificate), _PUBLIC)


@contextmanager
def _new_folder(folder: Path) -> Iterator[Path]:
    """A folder beside it that takes its place at the end of the body, or goes.

    Raises:
        ConfigurationError: there is something already. RunError: it can not be written.
    """
    if folder.is_symlink() or (folder.exists() and (not folder.is_dir() or any(folder.iterdir()))):
        raise ConfigurationError(f"{folder}: is there already; expected a new folder, nothing is overwritten")
    part = folder.with_name(f".{folder.name}.{os.getpid()}.part")
    try:
        with at_last(partial(shutil.rmtree, part, ignore_errors=True)):
            folder.parent.mkdir(parents=True, exist_ok=True)
            part.mkdir(mode=_FOLDER)
            yield part
            part.replace(folder)  # onto an empty folder, too
    except OSError as error:
        raise RunError(f"{folder}: {error.strerror or error}, nothing is written") from error


def _write(path: Path, content: bytes, mode: int) -> None:
    """A new file with exactly that mode from its first moment."""
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(handle, "wb") as file:
        os.fchmod(handle, mode)
        file.write(content)


def _replace(path: Path, content: bytes) -> None:
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with at_last(partial(part.unlink, missing_ok=True)):
            _write(part, content, _PUBLIC)
            part.replace(path)
    except OSError as error:
        raise RunError(f"{path}: {error.strerror or error}, not renewed") from error


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigurationError(
            f"{path}: {error.strerror or error}; expected a file of forefeel pki init"
        ) from error
