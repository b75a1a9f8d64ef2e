"""`forefeel pki`: what each subcommand does and says."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import typer
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from forefeel.common.clock import now_utc
from forefeel.common.errors import ConfigurationError
from forefeel.files import results_folder, write_all
from forefeel.interrupt import ends_in_order, heeded
from forefeel.pki import folder as store
from forefeel.pki.layout import (
    AUTHORITY_KEY,
    Member,
    checked_cells,
    chosen_members,
    members_of,
    parse_hosts,
)
from forefeel.pki.show import CertificateRow, rows
from forefeel.pki.zenoh_files import zenoh_files
from forefeel.terminal import SHADES, answer, show, table


def run_init(folder: Path, cells: Sequence[str], hosts: Sequence[str], days: int) -> None:
    """Makes the folder and says what goes where.

    Raises:
        ConfigurationError: a name, a host, or the folder can not be used; nothing was written.
    """
    names = checked_cells(cells)
    by_word = parse_hosts(hosts, members_of(names, apart=len(names) > 1))
    with ends_in_order("pki init", folder):
        members = store.make_folder(folder, names, by_word, days, now_utc())
    show(f"{folder}: an authority and {len(members)} certificates, valid for {days} days")
    _say_where(folder, members)
    show(f"keep {folder / AUTHORITY_KEY} off the hosts: it signs; forefeel pki renew and add need it")


def run_add(folder: Path, cell: str, hosts: Sequence[str], days: int) -> None:
    """Adds a cell and says what goes where.

    Raises:
        ConfigurationError: see `run_init`.
    """
    (name,) = checked_cells([cell])
    by_word = parse_hosts(hosts, [each for each in members_of([name], apart=True) if each.part])
    with ends_in_order("pki add", folder):
        members = store.add_cell(folder, name, by_word, days, now_utc())
    show(
        f"{folder / name}: {len(members)} certificates, valid for {days} days; tell the router of cell {name}"
    )
    _say_where(folder, members)


def run_show(folder: Path) -> None:
    """Answers what lies there.

    Raises:
        ConfigurationError: no folder of certificates. typer.Exit: 1, where one is red.
    """
    found = rows(folder, now_utc())
    answer(*_in_words(found), document=lambda: [asdict(row) for row in found])
    if any(row.colour == "red" for row in found):
        raise typer.Exit(1)


def run_renew(folder: Path, who: Sequence[str], hosts: Sequence[str], days: int) -> None:
    """Renews and says what to copy.

    Raises:
        ConfigurationError: nobody of that name, or no authority's key.
    """
    known = store.find_members(folder)
    members = chosen_members(who, known, "renew")
    with ends_in_order("pki renew", folder) as written, heeded():
        store.renew(folder, members, parse_hosts(hosts, members), days, now_utc())
        written.extend(str(each.certificate(folder).relative_to(folder)) for each in members)
    for member in members:
        show(f"{member.certificate(folder)}: renewed for {days} days; copy it to its host, the key stays")
    show("a daemon takes a new certificate at its next start")


def run_bundle(folder: Path, who: str, out: Path) -> None:
    """Puts the files of one role into a new folder.

    Raises:
        ConfigurationError: nobody of that name, several, or the folder is not new.
    """
    members = chosen_members([who], store.find_members(folder), "bundle")
    if len(members) > 1:
        known = ", ".join(member.word for member in members)
        raise ConfigurationError(f"bundle: {who!r}: expected one of {known}")
    with ends_in_order("pki bundle", out):
        files = store.bundle(folder, members[0], out)
    show(f"{out}: {', '.join(files)}; copy the folder to the host and name it in transport.pki")


def run_rules(cells: Sequence[str], folder: Path, out: Path, overwrite: bool) -> None:
    """Writes the Zenoh configuration of every role.

    Raises:
        ConfigurationError: a name can not be used, or there are such files. RunError: see `write_all`.
    """
    texts = zenoh_files(checked_cells(cells), folder)
    with (
        ends_in_order("pki rules", out) as written,
        results_folder(out, tuple(texts), "earlier files", overwrite),
    ):
        write_all(out, texts, written)
    show(f"{out}: {', '.join(texts)}")


def _in_words(found: Sequence[CertificateRow]) -> Iterator[RenderableType]:
    yield _table(found)
    for row in found:
        if row.advice:
            yield f"{row.colour}: {row.advice}"


def _table(found: Sequence[CertificateRow]) -> Table:
    made = table("", "file", "name", "hosts", "expires", "days", right=("days",))
    for row in found:
        cells = row.file, row.name, " ".join(row.hosts), row.expires[:10], str(row.days_left)
        made.add_row(Text(row.colour, SHADES[row.colour]), *map(Text, cells))
    return made


def _say_where(folder: Path, members: Sequence[Member]) -> None:
    show(f"what each host needs (forefeel pki bundle {folder} ROLE --out DIR puts it together):")
    for member in members:
        files = member.authority(folder), member.certificate(folder), member.key(folder)
        show(f"  {member.word}: {' '.join(str(path.relative_to(folder)) for path in files)}")
