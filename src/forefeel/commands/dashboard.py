"""`forefeel dashboard`."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import (
    Connect,
    Insecure,
    ObservedCell,
    ObserverConfig,
    ObserverPki,
    Quiet,
    ThroughRouter,
    examples,
    extra,
)
from forefeel.terminal import output

PACKAGES = ("starlette", "uvicorn", "ifaddr")
_ADDRESS = "Where the page is served; beyond this host it asks for the token of the link that is shown."

Address = Annotated[str, typer.Option("--address", help=_ADDRESS)]
Port = Annotated[int, typer.Option("--port", min=0, max=65535, help="Where the page is served; 0: any.")]
Open = Annotated[bool, typer.Option("--open", help="Open the page in the browser.")]
Vessel = Annotated[
    Path | None, typer.Option("--vessel", metavar="FILE", help="YAML profile of the vessel that is drawn.")
]


@examples(
    "forefeel dashboard --cell cathlab --connect tls/10.0.0.1:7447 --pki pki --open",
    "forefeel dashboard --config viewer.yaml",
)
def dashboard(  # noqa: PLR0913, PLR0917 - one parameter per option
    connect: Connect = None,
    cell: ObservedCell = None,
    config: ObserverConfig = None,
    pki: ObserverPki = None,
    through_router: ThroughRouter = False,
    insecure: Insecure = False,
    address: Address = "127.0.0.1",
    port: Port = 8600,
    opens: Open = False,
    vessel: Vessel = None,
    piped_scenes: Annotated[bool, typer.Option("--told", hidden=True)] = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.network_settings import observer  # noqa: PLC0415
    from forefeel.report.vessel import vessel_of  # noqa: PLC0415 - the help needs none of it

    settings, drawn = observer(config, cell, connect or [], pki, through_router), vessel_of(vessel)
    with extra("dashboard", *PACKAGES):
        from forefeel.dashboard.server import run_dashboard  # noqa: PLC0415
    with output(quiet=quiet):
        run_dashboard(settings, address, port, insecure, opens, drawn, sys.stdin if piped_scenes else None)
