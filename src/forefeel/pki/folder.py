"""The folder of an authority and what is copied from it to the hosts.

DIR/ca.key, DIR/ca.crt     the authority; the key stays here
DIR/CELL/ROLE/             for the host of that role: ca.crt, ROLE.crt, ROLE.key
DIR/router/                for the router: the same, and router.json5 with the rules for zenohd
"""

import ipaddress
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path, PurePath
from typing import Any, Literal

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.transport.pki import AUTHORITY, check_period, read_certificate, read_identity, renewal
from forefeel.common.transport.security import CELL_ROLES, ROLES, Party, PartyFiles, secured
from forefeel.common.transport.zenoh_config import FIXED
from forefeel.files import whole
from forefeel.pki.authority import (
    AUTHORITY_NAME,
    THIS_HOST,
    Authority,
    certificate_pem,
    hosts_of,
    key_pem,
    new_key,
)

AUTHORITY_KEY = "ca.key"
RENEWED_WITHIN = timedelta(days=30)  # certificates that end sooner are amber, and renewed by the next init
ON_THE_HOST = PurePath("/etc/forefeel/pki")  # where router.json5 looks for the router's certificate

_SECRET, _PUBLIC = 0o600, 0o644
_CELL = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,45}")  # a common name has at most 64 characters
_HOST = re.compile(r"(?=.{1,253}$)[A-Za-z0-9](?:[A-Za-z0-9-]{0,62})(?:\.[A-Za-z0-9][A-Za-z0-9-]{0,62})*")
_NAME = re.compile(rf"forefeel-(?P<cell>.+)-(?P<role>{'|'.join(CELL_ROLES)})")


def init_folder(
    folder: Path, cells: Sequence[str], hosts: Sequence[str], days: int, now: datetime
) -> dict[Path, str]:
    """Makes what is missing of authority, keys and certificates, renews certificates that end soon or are to
    name other hosts, and writes router.json5 anew; the authority and every key stay.

    Args:
        folder: new, empty, or one of this function; cells that it has need not be named.
        hosts: `[CELL/]ROLE=HOST,HOST`, without CELL for each of `cells`, if any; others keep theirs.
        days: how long new certificates are valid.

    Returns:
        By folder of a host: `new`, `renewed` or `unchanged`.

    Raises:
        ConfigurationError: a name or a host can not be used, or the folder is none of ours; nothing is
            written. RunError: it can not be written; called again it goes on.
    """
    there = {path.parents[1].name for path in folder.glob("*/*/*.crt") if path.name != AUTHORITY}
    named, cells = cells, _checked_cells([*cells, *sorted(there.difference(cells))])
    parties = [Party(role, (cell,)) for cell in cells for role in CELL_ROLES] + [Party("router", cells)]
    given = _parsed_hosts(hosts, parties, named)
    if not (folder / AUTHORITY).exists() and (
        folder.is_symlink() or (folder.exists() and (not folder.is_dir() or any(folder.iterdir())))
    ):
        raise ConfigurationError(f"{folder}: is there already; expected a new folder, or one of pki init")
    try:
        authority = _authority(folder, now)
        done = {}
        for party in parties:
            inside = folder / _place(party)
            done[inside] = _issue(inside, authority, party, given.get(_place(party)), days, now)
        _write(folder / "router" / "router.json5", router_file(cells).encode(), _PUBLIC)
    except OSError as error:
        raise RunError(f"{error.filename or folder}: {error.strerror or error}; try again") from error
    return done


def _authority(folder: Path, now: datetime) -> Authority:
    """Reads the authority; first makes folder (mode 0700), key and certificate where there is no certificate.
    ConfigurationError: expired, or as `read_authority`.
    """
    certificate, key = folder / AUTHORITY, folder / AUTHORITY_KEY
    if not certificate.exists():
        made = Authority.new(now)
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.chmod(0o700)
        _write(key, key_pem(made.key), _SECRET)
        _write(certificate, certificate_pem(made.certificate), _PUBLIC)
    authority = read_authority(folder)
    if now >= authority.certificate.not_valid_after_utc:
        raise ConfigurationError(f"{certificate}: expired; expected {renewal(certificate)}")
    return authority


def _issue(
    inside: Path,
    authority: Authority,
    party: Party,
    hosts: Sequence[str] | None,
    days: int,
    now: datetime,
) -> str:
    """Makes key and certificate of a party, or renews a certificate, with its old key, that ends within 30
    days or whose hosts are not `hosts`; returns `new`, `renewed` or `unchanged`. `hosts` None: those it has.
    ConfigurationError: the old certificate can not be read, or is not on an elliptic curve.
    """
    path = inside / f"{party.role}.crt"
    if path.exists():
        old = read_certificate(path)
        hosts = hosts_of(old) if hosts is None else hosts
        same = set(hosts).difference(THIS_HOST) == set(hosts_of(old))
        if old.not_valid_after_utc - now >= RENEWED_WITHIN and same:
            return "unchanged"
        public, what = old.public_key(), "renewed"
        if not isinstance(public, ec.EllipticCurvePublicKey):
            raise ConfigurationError(f"{path}: not on an elliptic curve; expected one of forefeel pki init")
    else:
        key, what = new_key(), "new"
        public = key.public_key()
        inside.mkdir(mode=0o700, parents=True, exist_ok=True)
        _write(inside / f"{party.role}.key", key_pem(key), _SECRET)
        _write(inside / AUTHORITY, certificate_pem(authority.certificate), _PUBLIC)
    _write(path, certificate_pem(authority.sign(party.name, public, hosts or (), now, days)), _PUBLIC)
    return what


def read_authority(folder: Path) -> Authority:
    """Reads key and certificate of the authority from the folder. ConfigurationError: one is missing or
    unreadable, or they do not match.
    """
    path = folder / AUTHORITY_KEY
    try:
        key = load_pem_private_key(path.read_bytes(), None)
    except (OSError, ValueError, TypeError) as error:
        cause = error.strerror if isinstance(error, OSError) else "no private key"
        raise ConfigurationError(f"{path}: {cause}; expected the one of forefeel pki init") from error
    certificate = read_certificate(folder / AUTHORITY)
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
        raise ConfigurationError(
            f"{path}: does not belong to {AUTHORITY}; expected both of one forefeel pki init"
        )
    return Authority(certificate, key)


@dataclass(frozen=True, slots=True)
class CertificateRow:
    """One certificate. `advice` says what is wrong and what to do where it is not green."""

    file: str
    name: str
    hosts: tuple[str, ...]
    expires: str
    days_left: int
    colour: Literal["green", "amber", "red"]
    advice: str


def certificate_rows(folder: Path, now: datetime) -> list[CertificateRow]:
    """Rows of the `.crt` files up to two folders down, the authority's first; skips those that name no party.
    ConfigurationError: no certificate of a party, or one that can not be read.
    """
    paths = sorted(path for depth in ("", "*/", "*/*/") for path in folder.glob(f"{depth}*.crt"))
    named = [(path, _party(read_certificate(path))) for path in paths if path.name != AUTHORITY]
    ends = [(path, party) for path, party in named if party is not None]
    if not ends:
        raise ConfigurationError(f"{folder}: no certificates; expected a folder of forefeel pki init")
    authority = folder / AUTHORITY
    rows = [_row(folder, authority, None, now)] if authority.exists() else []
    return rows + [_row(folder, path, party, now) for path, party in ends]


def _row(folder: Path, path: Path, party: Party | None, now: datetime) -> CertificateRow:
    """Row of a certificate, `party` None for the authority's: green, amber when it ends within 30 days, red
    when it or its key is not accepted; with the advice. ConfigurationError: it can not be read.
    """
    certificate, advice = read_certificate(path), ""
    left = certificate.not_valid_after_utc - now
    colour: Literal["green", "amber", "red"] = "green" if left >= RENEWED_WITHIN else "amber"
    if colour == "amber":
        advice = f"{path}: ends soon; expected {renewal(path)}"
    try:
        check_period(path, certificate, now) if party is None else read_identity(path.parent, party, now)
    except ConfigurationError as error:
        colour, advice = "red", str(error)
    name = AUTHORITY_NAME if party is None else party.name
    expires = f"{certificate.not_valid_after_utc:%Y-%m-%dT%H:%M:%SZ}"
    file = str(path.relative_to(folder))
    return CertificateRow(file, name, hosts_of(certificate), expires, left.days, colour, advice)


def router_file(cells: Sequence[str]) -> str:
    """Text of router.json5 for zenohd, a router of those cells: TLS, and the topic table's access rules."""
    files = PartyFiles(ON_THE_HOST / AUTHORITY, ON_THE_HOST / "router.crt", ON_THE_HOST / "router.key")
    listen = {"mode": "router", "listen/endpoints": ["tls/0.0.0.0:7447"]}
    tree: dict[str, Any] = {}
    for path, value in {**listen, **FIXED, **secured(Party("router", tuple(cells)), files)}.items():
        *above, last = path.split("/")
        inside = tree
        for name in above:
            inside = inside.setdefault(name, {})
        inside[last] = value
    return f"// Written by `forefeel pki init` from the topic table.\n{json.dumps(tree, indent=2)}\n"


def _place(party: Party) -> str:
    """The folder of a host in that of the authority, as `--hosts` names it, too."""
    return "router" if party.role == "router" else f"{party.cells[0]}/{party.role}"


def _party(certificate: x509.Certificate) -> Party | None:
    """Party that the certificate's common name stands for, a router's without cells; None: none of ours."""
    names = certificate.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
    name = str(names[0].value) if names else ""
    if name == Party("router", ()).name:
        return Party("router", ())
    match = _NAME.fullmatch(name)
    return match and Party(next(role for role in ROLES if role == match["role"]), (match["cell"],))


def _checked_cells(cells: Sequence[str]) -> tuple[str, ...]:
    """Returns the cells. ConfigurationError: none, one twice, or a name that can not be used, as `router`."""
    for cell in cells:
        if not _CELL.fullmatch(cell) or cell == "router":
            raise ConfigurationError(
                f"--cell {cell!r}: expected 1 to 46 letters, digits, '.', '_' or '-', the first no sign"
            )
    if not cells or len(set(cells)) != len(cells):
        raise ConfigurationError(f"--cell {', '.join(cells) or 'missing'}: expected each name once")
    return tuple(cells)


def _parsed_hosts(
    words: Sequence[str], parties: Sequence[Party], named: Sequence[str]
) -> Mapping[str, Sequence[str]]:
    """Parses words of `--hosts`; returns the hosts by the party's folder (`_place`). A role alone means that
    of every cell in `named`, or of all where it is empty. ConfigurationError: no `=`, nobody of `parties`, or
    no host.
    """
    of_named = [party for party in parties if not named or not set(named).isdisjoint(party.cells)]
    hosts: dict[str, list[str]] = {}
    for text in words:
        who, equals, listed = text.partition("=")
        if not equals:
            raise ConfigurationError(
                f"--hosts {text!r}: expected ROLE=HOST,HOST as in slave=10.0.0.1,slave-host"
            )
        meant = [_place(party) for party in parties if who == _place(party)]
        meant = meant or [_place(party) for party in of_named if who == party.role]
        if not meant:
            known = ", ".join(_place(party) for party in parties)
            raise ConfigurationError(f"--hosts {text!r}: {who!r} is nobody here; expected one of {known}")
        names = [_host(name.strip(), text) for name in listed.split(",")]
        for word in meant:
            hosts.setdefault(word, []).extend(names)
    return hosts


def _host(name: str, where: str) -> str:
    """Host name, or address in its usual form. ConfigurationError, with `where`: neither."""
    bare = name.strip("[]")
    try:
        return str(ipaddress.ip_address(bare))
    except ValueError:
        # of digits and dots only: an address with a mistake in it
        if not _HOST.fullmatch(bare) or re.fullmatch(r"[\d.]+", bare):
            raise ConfigurationError(
                f"--hosts {where!r}: {name!r}: expected a host name or an address"
            ) from None
    return bare


def _write(path: Path, content: bytes, mode: int) -> None:
    """Replaces the file at once; it has that mode from its first moment."""
    with whole(path, "the certificate") as part:
        part.touch(_SECRET)
        part.chmod(mode)
        part.write_bytes(content)
