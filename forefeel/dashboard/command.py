"""`forefeel dashboard` and `forefeel view` on the command line."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.extras import extra
from forefeel.options import (
    Connect,
    Duration,
    Insecure,
    Quiet,
    ThroughRouter,
    ViewedCell,
    ViewerConfig,
    ViewerPki,
)
from forefeel.terminal import output

EPILOG = (
    "Example: forefeel dashboard --cell cathlab --connect tls/10.0.0.1:7447 --pki pki --open   "
    "Example: forefeel dashboard --config viewer.yaml"
)
VIEW_EPILOG = "Example: forefeel view out/demo/recording.mcap --open"
_PACKAGES = ("nicegui", "fastapi", "uvicorn")
_ADDRESS = "Where the page is served; beyond this host it asks for the token of the link that is shown."

Address = Annotated[str, typer.Option("--address", help=_ADDRESS)]
Port = Annotated[int, typer.Option("--port", min=0, max=65535, help="Where the page is served; 0: any.")]
Open = Annotated[bool, typer.Option("--open", help="Open the page in the browser.")]


def dashboard(  # noqa: PLR0913, PLR0917 - one parameter per option
    connect: Connect = None,
    cell: ViewedCell = None,
    config: ViewerConfig = None,
    pki: ViewerPki = None,
    through_router: ThroughRouter = False,
    insecure: Insecure = False,
    address: Address = "127.0.0.1",
    port: Port = 8600,
    opens: Open = False,
    duration: Duration = None,
    quiet: Quiet = False,
) -> None:
    """Show a cell live in the browser, as a viewer in a process of its own, which commands nothing."""
    from forefeel.network_settings import observer  # noqa: PLC0415 - the others start without Zenoh

    found = observer(config, cell, connect or [], pki, through_router)
    with extra("dashboard", *_PACKAGES, command="dashboard"):
        from forefeel.dashboard.server import run_dashboard  # noqa: PLC0415
    with output(quiet=quiet):
        run_dashboard(found, address, port, duration, insecure, opens)


def view(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recorded run (MCAP).")],
    address: Address = "127.0.0.1",
    port: Port = 8600,
    opens: Open = False,
    duration: Duration = None,
    quiet: Quiet = False,
) -> None:
    """Show a recorded run in the same page, at any of its times."""
    with extra("dashboard", *_PACKAGES, command="view"):
        from forefeel.dashboard.server import run_view  # noqa: PLC0415
    with output(quiet=quiet):
        run_view(file, address, port, duration, opens)
