"""`forefeel device`: the devices of a configuration."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import AsJson, Quiet, examples, number
from forefeel.terminal import output, suggest


@examples("forefeel device probe --config deploy/config/slave.yaml")
def probe(
    config: Annotated[Path, typer.Option("--config", metavar="FILE", help="Slave's or master's YAML file.")],
    seconds: Annotated[float, number("S", 0.05, 3600.0, "How long each is read.")] = 2.0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.probe.probe import run_probe  # noqa: PLC0415

    with output(as_json, quiet):
        run_probe(config, seconds)
        suggest("doctor", config=config)
