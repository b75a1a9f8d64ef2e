"""`forefeel pki`: certificates."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import AsJson, Quiet, examples
from forefeel.terminal import output

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="The folder of certificates.")]
Cells = Annotated[list[str], typer.Option("--cell", metavar="NAME", help="A cell; repeat it.")]
Hosts = Annotated[
    list[str] | None,
    typer.Option("--hosts", metavar="[CELL/]ROLE=HOST,HOST", help="Where others reach that role; repeat it."),
]
Days = Annotated[int, typer.Option(min=1, max=3650, help="How long the roles' certificates are valid.")]


@examples(
    "forefeel pki init deploy/config/pki --cell cathlab --hosts slave=10.0.0.1,slave-host",
    "forefeel pki init pki --cell cell1 --cell cell2 --hosts router=10.0.0.5 --days 90",
)
def init(folder: Folder, cell: Cells, hosts: Hosts = None, days: Days = 365) -> None:
    from forefeel.pki.run import run_init  # noqa: PLC0415 - the help needs none of it

    run_init(folder, cell, hosts or [], days)


@examples("forefeel pki add pki --cell cell3 --hosts slave=10.0.0.7")
def add(
    folder: Folder,
    cell: Annotated[str, typer.Option("--cell", metavar="NAME", help="The new cell.")],
    hosts: Hosts = None,
    days: Days = 365,
) -> None:
    from forefeel.pki.run import run_add  # noqa: PLC0415

    run_add(folder, cell, hosts or [], days)


@examples("forefeel pki show pki", "forefeel pki show pki --json")
def show(folder: Folder, as_json: AsJson = False, quiet: Quiet = False) -> None:
    from forefeel.pki.run import run_show  # noqa: PLC0415

    with output(as_json, quiet):
        run_show(folder)


@examples("forefeel pki renew pki", "forefeel pki renew pki slave --hosts slave=10.0.0.9")
def renew(
    folder: Folder,
    who: Annotated[
        list[str] | None, typer.Argument(metavar="[[CELL/]ROLE]...", help="All where none is named.")
    ] = None,
    hosts: Hosts = None,
    days: Days = 365,
) -> None:
    from forefeel.pki.run import run_renew  # noqa: PLC0415

    run_renew(folder, who or [], hosts or [], days)


@examples("forefeel pki bundle pki slave --out for-the-slave/pki")
def bundle(
    folder: Folder,
    who: Annotated[str, typer.Argument(metavar="[CELL/]ROLE", help="Whose files.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="A new folder.")],
) -> None:
    from forefeel.pki.run import run_bundle  # noqa: PLC0415

    run_bundle(folder, who, out)


@examples("forefeel pki rules --cell cathlab --folder /etc/forefeel/pki --out deploy/zenoh")
def rules(
    cell: Cells,
    out: Annotated[Path, typer.Option(metavar="DIR", help="For ROLE.json5.")],
    folder: Annotated[
        Path, typer.Option("--folder", metavar="DIR", help="Where each host keeps its certificates.")
    ] = Path("/etc/forefeel/pki"),
    overwrite: Annotated[bool, typer.Option(help="Replace earlier files in DIR.")] = False,
) -> None:
    from forefeel.pki.run import run_rules  # noqa: PLC0415

    run_rules(cell, folder, out, overwrite)
