"""`forefeel devices` and `forefeel device probe`: what stands on the command line."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.options import AsJson, Quiet
from forefeel.terminal import output

EPILOG = "Example: forefeel devices   Example: forefeel devices --json"
device_app = typer.Typer(help="The devices of a configuration.", no_args_is_help=True)


def devices(as_json: AsJson = False, quiet: Quiet = False) -> None:
    """List drivers, serial ports with their stable names, and CAN interfaces."""
    from forefeel.devices.listing import run_devices  # noqa: PLC0415 - other commands start without it

    with output(as_json, quiet):
        run_devices()


@device_app.callback()
def _group() -> None:
    """The devices of a configuration."""


@device_app.command("probe", epilog="Example: forefeel device probe --config deploy/config/slave.yaml")
def device_probe(
    config: Annotated[Path, typer.Option("--config", metavar="FILE", help="Slave's or master's YAML file.")],
    seconds: Annotated[float, typer.Option("--seconds", metavar="S", help="How long each is read.")] = 2.0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Talk to each device: what it is, its rate and round trip, its link. Nothing is moved."""
    from forefeel.devices.probing import run_probe  # noqa: PLC0415

    with output(as_json, quiet):
        run_probe(config, seconds)
