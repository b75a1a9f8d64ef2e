"""`forefeel record`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import (
    Connect,
    Duration,
    Insecure,
    ObservedCell,
    ObserverConfig,
    ObserverPki,
    Quiet,
    ThroughRouter,
    examples,
)
from forefeel.terminal import output, suggest


@examples(
    "forefeel record --config deploy/config/recorder.yaml --out run.mcap",
    "forefeel record --cell cathlab --connect tls/10.0.0.1:7447 --pki pki --out run.mcap",
)
def record(  # noqa: PLR0913, PLR0917 - one parameter per option
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="A new .mcap file.")],
    connect: Connect = None,
    cell: ObservedCell = None,
    config: ObserverConfig = None,
    pki: ObserverPki = None,
    through_router: ThroughRouter = False,
    insecure: Insecure = False,
    duration: Duration = None,
    quiet: Quiet = False,
) -> None:
    from forefeel.network_settings import observer  # noqa: PLC0415
    from forefeel.recorder import run_record  # noqa: PLC0415 - the help needs none of it

    settings = observer(config, cell, connect or [], pki, through_router)
    with output(quiet=quiet):
        run_record(out, settings, duration, insecure)
        suggest("report", out, out=out.with_suffix(""))
