"""`forefeel config`: settings."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import AsJson, Quiet, examples
from forefeel.common.config import dump_yaml
from forefeel.daemon_settings import load_any
from forefeel.terminal import answer, output


@examples("forefeel config check deploy/config/slave.yaml")
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE")], as_json: AsJson = False, quiet: Quiet = False
) -> None:
    settings = load_any(file)
    with output(as_json, quiet):
        answer(dump_yaml(settings).rstrip("\n"), document=lambda: settings.model_dump(mode="json"))
