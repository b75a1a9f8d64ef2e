"""`forefeel pki`: certificates."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import AsJson, Quiet, examples
from forefeel.terminal import SHADES, answer, output, suggest, table
from forefeel.terminal import show as say

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="The folder of certificates.")]


@examples(
    "forefeel pki init pki --cell cathlab --hosts slave=10.0.0.1,slave-host --hosts master=10.0.0.2",
    "forefeel pki init pki --cell cell2 --hosts router=10.0.0.5 --days 90",
)
def init(
    folder: Folder,
    cell: Annotated[
        list[str] | None,
        typer.Option("--cell", metavar="NAME", help="A cell; repeat it. Those that DIR has may be left out."),
    ] = None,
    hosts: Annotated[
        list[str] | None,
        typer.Option(
            "--hosts", metavar="[CELL/]ROLE=HOST,HOST", help="Where others reach that role; repeat it."
        ),
    ] = None,
    days: Annotated[int, typer.Option(min=1, max=3650, help="How long new certificates are valid.")] = 365,
) -> None:
    """Called again, it adds cells, renews what ends within 30 days and changes hosts; all keys stay."""
    from forefeel.common.clock import now_utc  # noqa: PLC0415 - the help needs none of it
    from forefeel.interrupt import ends_in_order, signal_flag  # noqa: PLC0415
    from forefeel.pki.folder import AUTHORITY_KEY, init_folder  # noqa: PLC0415

    # a signal waits until all is there: a key of the authority without its certificate is of no use again
    with ends_in_order("pki init", folder) as written, signal_flag():
        done = init_folder(folder, cell or [], hosts or [], days, now_utc())
        written.append("all certificates")
    for place, what in done.items():
        say(f"{what:<9} {place}")
    if set(done.values()) != {"unchanged"}:
        say(
            "copy new folders as a whole and of renewed ones the .crt to their hosts, for transport.pki; "
            f"keep {folder / AUTHORITY_KEY} off the hosts"
        )
    suggest("pki", "show", folder)


@examples("forefeel pki show pki", "forefeel pki show pki --json")
def show(folder: Folder, as_json: AsJson = False, quiet: Quiet = False) -> None:
    from rich.text import Text  # noqa: PLC0415

    from forefeel.common.clock import now_utc  # noqa: PLC0415
    from forefeel.pki.folder import certificate_rows  # noqa: PLC0415

    with output(as_json, quiet):
        rows = certificate_rows(folder, now_utc())
        shown = table("", "file", "name", "hosts", "expires", "days", right=("days",))
        for row in rows:
            cells = row.file, row.name, " ".join(row.hosts), row.expires[:10], str(row.days_left)
            shown.add_row(Text(row.colour, SHADES[row.colour]), *map(Text, cells))
        advice = [f"{row.colour}: {row.advice}" for row in rows if row.advice]
        answer(shown, *advice, document=lambda: [asdict(row) for row in rows])
        suggest(*(["pki", "init", folder] if advice else ["doctor"]))
        if any(row.colour == "red" for row in rows):
            raise typer.Exit(1)
