"""`forefeel pki`: what stands on the command line."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.options import AsJson, Quiet
from forefeel.terminal import output

pki_app = typer.Typer(help="Certificates of the cells of a laboratory.", no_args_is_help=True)
Folder = Annotated[Path, typer.Argument(metavar="DIR", help="The folder of certificates.")]
Cells = Annotated[list[str], typer.Option("--cell", metavar="NAME", help="A cell; repeat it.")]
Hosts = Annotated[
    list[str] | None,
    typer.Option("--hosts", metavar="[CELL/]ROLE=HOST,HOST", help="Where others reach that role; repeat it."),
]
Days = Annotated[int, typer.Option(min=1, max=3650, help="How long the roles' certificates are valid.")]


@pki_app.command(
    "init",
    epilog="Example: forefeel pki init deploy/config/pki --cell cathlab --hosts slave=10.0.0.1,slave-host   "
    "Example: forefeel pki init pki --cell cell1 --cell cell2 --hosts router=10.0.0.5 --days 90",
)
def pki_init(folder: Folder, cell: Cells, hosts: Hosts = None, days: Days = 365) -> None:
    """Make an authority and a certificate for each role, in a new folder."""
    from forefeel.pki.command import run_init  # noqa: PLC0415 - other commands start without it

    run_init(folder, cell, hosts or [], days)


@pki_app.command("add", epilog="Example: forefeel pki add pki --cell cell3 --hosts slave=10.0.0.7")
def pki_add(
    folder: Folder,
    cell: Annotated[str, typer.Option("--cell", metavar="NAME", help="The new cell.")],
    hosts: Hosts = None,
    days: Days = 365,
) -> None:
    """Add a cell under the authority of a folder."""
    from forefeel.pki.command import run_add  # noqa: PLC0415

    run_add(folder, cell, hosts or [], days)


@pki_app.command("show", epilog="Example: forefeel pki show pki   Example: forefeel pki show pki --json")
def pki_show(folder: Folder, as_json: AsJson = False, quiet: Quiet = False) -> None:
    """Show names, hosts and expiry; exit 1 where one is red."""
    from forefeel.pki.command import run_show  # noqa: PLC0415

    with output(as_json, quiet):
        run_show(folder)


@pki_app.command(
    "renew",
    epilog="Example: forefeel pki renew pki   Example: forefeel pki renew pki slave --hosts slave=10.0.0.9",
)
def pki_renew(
    folder: Folder,
    who: Annotated[
        list[str] | None, typer.Argument(metavar="[[CELL/]ROLE]...", help="All where none is named.")
    ] = None,
    hosts: Hosts = None,
    days: Days = 365,
) -> None:
    """Renew certificates with the authority's key; hosts that are not given stay as they are."""
    from forefeel.pki.command import run_renew  # noqa: PLC0415

    run_renew(folder, who or [], hosts or [], days)


@pki_app.command("bundle", epilog="Example: forefeel pki bundle pki slave --out for-the-slave/pki")
def pki_bundle(
    folder: Folder,
    who: Annotated[str, typer.Argument(metavar="[CELL/]ROLE", help="Whose files.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="A new folder.")],
) -> None:
    """Put together what the host of one role needs, and nothing else."""
    from forefeel.pki.command import run_bundle  # noqa: PLC0415

    run_bundle(folder, who, out)


@pki_app.command(
    "rules",
    epilog="Example: forefeel pki rules --cell cathlab --folder /etc/forefeel/pki --out deploy/zenoh",
)
def pki_rules(
    cell: Cells,
    out: Annotated[Path, typer.Option(metavar="DIR", help="For ROLE.json5.")],
    folder: Annotated[
        Path, typer.Option("--folder", metavar="DIR", help="Where each host keeps its certificates.")
    ] = Path("/etc/forefeel/pki"),
    overwrite: Annotated[bool, typer.Option(help="Replace earlier files in DIR.")] = False,
) -> None:
    """Write the Zenoh configuration of a router and of each role: TLS and what each may say and hear."""
    from forefeel.pki.command import run_rules  # noqa: PLC0415

    run_rules(cell, folder, out, overwrite)
