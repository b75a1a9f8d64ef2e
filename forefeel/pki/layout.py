"""Where what lies in a folder of certificates, and what is asked for on the command line.

One cell: DIR/ca.crt, DIR/ca.key, DIR/ROLE.crt, DIR/ROLE.key. Several: DIR/CELL/ROLE.crt and so on with a
copy of ca.crt beside them, so that DIR/CELL is what `transport.pki` names; the router's lie in DIR.
"""

import ipaddress
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from forefeel.common.errors import ConfigurationError
from forefeel.common.transport.pki import AUTHORITY
from forefeel.common.transport.security import CELL_ROLES, ROLES, Party, PartyRole

AUTHORITY_KEY = "ca.key"
_CELL = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,45}")  # a common name has at most 64 characters
_HOST = re.compile(r"(?=.{1,253}$)[A-Za-z0-9](?:[A-Za-z0-9-]{0,62})(?:\.[A-Za-z0-9][A-Za-z0-9-]{0,62})*")


@dataclass(frozen=True, slots=True)
class Member:
    """One certificate of a folder: whose, and in which part of the folder."""

    party: Party
    part: str = ""

    @property
    def word(self) -> str:
        """How the command line names it."""
        return f"{self.part}/{self.party.role}" if self.part else self.party.role

    def certificate(self, folder: Path) -> Path:
        """Its certificate's file."""
        return folder / self.part / f"{self.party.role}.crt"

    def key(self, folder: Path) -> Path:
        """Its key's file."""
        return folder / self.part / f"{self.party.role}.key"

    def authority(self, folder: Path) -> Path:
        """The certificate of the authority beside it."""
        return folder / self.part / AUTHORITY


def members_of(cells: Sequence[str], apart: bool) -> list[Member]:
    """Everyone in those cells and the router; `apart`: each cell has a folder of its own."""
    found = [Member(Party(role, (cell,)), cell if apart else "") for cell in cells for role in CELL_ROLES]
    return [*found, router_of(cells)]


def router_of(cells: Sequence[str]) -> Member:
    """The router's certificate, which lies at the top."""
    return Member(Party("router", tuple(cells)))


def checked_cells(cells: Sequence[str]) -> tuple[str, ...]:
    """The names, each usable in a certificate, a key expression and as a folder.

    Raises:
        ConfigurationError: one is not, or stands twice.
    """
    for cell in cells:
        if not _CELL.fullmatch(cell) or cell.endswith((".crt", ".key")):
            raise ConfigurationError(
                f"--cell {cell!r}: expected 1 to 46 letters, digits, '.', '_' or '-', the first no sign"
            )
    if len(set(cells)) != len(cells):
        raise ConfigurationError(f"--cell {', '.join(cells)}: expected each name once")
    return tuple(cells)


def parse_hosts(words: Sequence[str], members: Sequence[Member]) -> dict[str, tuple[str, ...]]:
    """`[CELL/]ROLE=HOST,HOST`, repeated, as hosts by the member's word; ROLE alone means that of every cell.

    Raises:
        ConfigurationError: no such form, an unknown role or cell, or no host name or address.
    """
    hosts: dict[str, tuple[str, ...]] = {}
    for text in words:
        who, equals, listed = text.partition("=")
        if not equals:
            raise ConfigurationError(
                f"--hosts {text!r}: expected ROLE=HOST,HOST as in slave=10.0.0.1,slave-host"
            )
        meant = chosen_members([who], members, f"--hosts {text!r}")
        names = tuple(_host(each.strip(), text) for each in listed.split(","))
        for member in meant:
            hosts[member.word] = (*hosts.get(member.word, ()), *names)
    return hosts


def chosen_members(words: Sequence[str], members: Sequence[Member], where: str) -> list[Member]:
    """Those that the words name; none named, all of them.

    Raises:
        ConfigurationError: a word names nobody.
    """
    found: list[Member] = []
    for word in words:
        matching = [each for each in members if word in {each.word, each.party.role}]
        if not matching:
            known = ", ".join(each.word for each in members)
            raise ConfigurationError(f"{where}: {word!r} is nobody here; expected one of {known}")
        found += [each for each in matching if each not in found]
    return found if words else list(members)


def _host(name: str, where: str) -> str:
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


_NAME = re.compile(rf"forefeel-(?P<cell>.+)-(?P<role>{'|'.join(CELL_ROLES)})")


def party_named(common_name: str) -> tuple[PartyRole, str] | None:
    """The role and the cell that a common name tells; the router's cell is empty."""
    if common_name == Party("router", ()).name:
        return "router", ""
    found = _NAME.fullmatch(common_name)
    if found is None:
        return None
    return next(role for role in ROLES if role == found["role"]), found["cell"]
