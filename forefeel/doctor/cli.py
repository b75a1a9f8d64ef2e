"""`forefeel doctor` on the command line."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.options import AsJson, Quiet
from forefeel.terminal import output

EPILOG = (
    "Example: forefeel doctor --config deploy/config/slave.yaml   "
    "Example: forefeel doctor --config slave.yaml --config master.yaml --json"
)


def doctor(
    config: Annotated[
        list[Path] | None,
        typer.Option("--config", metavar="FILE", help="A slave's or master's YAML file; one of each."),
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Check this host and these settings: green, amber, red, and what to do. Exit 1 when anything is red."""
    from forefeel.doctor.command import run_doctor  # noqa: PLC0415 - other commands start without it

    with output(as_json, quiet):
        run_doctor(config or [])
