"""`forefeel doctor`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import AsJson, Quiet, examples
from forefeel.terminal import output


@examples(
    "forefeel doctor --config deploy/config/slave.yaml",
    "forefeel doctor --config slave.yaml --config master.yaml --json",
)
def doctor(
    config: Annotated[
        list[Path] | None,
        typer.Option("--config", metavar="FILE", help="A slave's or master's YAML file; one of each."),
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.doctor.run import run_doctor  # noqa: PLC0415 - the help needs none of it

    with output(as_json, quiet):
        run_doctor(config or [])
