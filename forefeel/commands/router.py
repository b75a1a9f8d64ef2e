"""`forefeel router`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import Duration, Insecure, Quiet, examples
from forefeel.terminal import output


@examples(
    "forefeel router --config deploy/config/router.yaml",
    "forefeel router --listen tls/0.0.0.0:7447 --pki pki --cell cell1 --cell cell2",
)
def router(
    config: Annotated[
        Path | None, typer.Option("--config", metavar="FILE", help="YAML instead of the options.")
    ] = None,
    listen: Annotated[
        list[str] | None, typer.Option("--listen", metavar="ENDPOINT", help="Where it listens; repeat it.")
    ] = None,
    pki: Annotated[
        Path | None, typer.Option("--pki", metavar="DIR", help="Certificates of the role router.")
    ] = None,
    cell: Annotated[
        list[str] | None, typer.Option("--cell", metavar="NAME", help="A cell it serves; repeat it.")
    ] = None,
    insecure: Insecure = False,
    duration: Duration = None,
    quiet: Quiet = False,
) -> None:
    from forefeel.network_settings import router_settings  # noqa: PLC0415
    from forefeel.router import run_router  # noqa: PLC0415 - the help needs none of it

    with output(quiet=quiet):
        run_router(router_settings(config, cell or [], listen or [], pki), duration, insecure)
