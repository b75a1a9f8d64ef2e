"""`forefeel metrics`."""

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
    extra,
)
from forefeel.terminal import output


@examples("forefeel metrics --cell cathlab --connect tls/10.0.0.1:7447 --pki pki")
def metrics(  # noqa: PLR0913, PLR0917 - one parameter per option
    connect: Connect = None,
    cell: ObservedCell = None,
    config: ObserverConfig = None,
    pki: ObserverPki = None,
    through_router: ThroughRouter = False,
    insecure: Insecure = False,
    address: Annotated[str, typer.Option("--address", help="Where Prometheus asks.")] = "127.0.0.1",
    port: Annotated[int, typer.Option("--port", min=1, max=65535, help="Where Prometheus asks.")] = 9464,
    duration: Duration = None,
    quiet: Quiet = False,
) -> None:
    from forefeel.network_settings import observer  # noqa: PLC0415 - the help needs none of it

    with extra("metrics", "prometheus_client"):
        from forefeel.metrics import run_metrics  # noqa: PLC0415
    settings = observer(config, cell, connect or [], pki, through_router)
    with output(quiet=quiet):
        run_metrics(settings, address, port, duration, insecure)
