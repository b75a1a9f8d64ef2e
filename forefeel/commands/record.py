"""`forefeel record`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import Connect, Duration, Insecure, Quiet, ThroughRouter, examples
from forefeel.terminal import output


@examples(
    "forefeel record --config deploy/config/recorder.yaml --out run.mcap",
    "forefeel record --cell cathlab --connect tls/10.0.0.1:7447 --pki pki --out run.mcap",
)
def record(  # noqa: PLR0913, PLR0917 - one parameter per option
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="A new .mcap file.")],
    connect: Connect = None,
    cell: Annotated[str | None, typer.Option("--cell", help="Which cell to record; default cell.")] = None,
    config: Annotated[
        Path | None,
        typer.Option("--config", metavar="FILE", help="YAML with cell and transport instead of the options."),
    ] = None,
    pki: Annotated[
        Path | None, typer.Option("--pki", metavar="DIR", help="Certificates of the role recorder.")
    ] = None,
    through_router: ThroughRouter = False,
    insecure: Insecure = False,
    duration: Duration = None,
    quiet: Quiet = False,
) -> None:
    from forefeel.network_settings import observer  # noqa: PLC0415
    from forefeel.recorder import run_record  # noqa: PLC0415 - the help needs none of it

    found = observer(config, cell, connect or [], pki, through_router)
    with output(quiet=quiet):
        run_record(out, found, duration, insecure)
