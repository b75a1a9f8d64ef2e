"""`forefeel router`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import Duration, Insecure, Quiet, examples
from forefeel.terminal import output


@examples("forefeel router --config deploy/config/router.yaml")
def router(
    config: Annotated[Path, typer.Option("--config", metavar="FILE", help="The router's YAML file.")],
    duration: Duration = None,
    insecure: Insecure = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.common.config import load_settings  # noqa: PLC0415
    from forefeel.network_settings import RouterSettings  # noqa: PLC0415
    from forefeel.router import run_router  # noqa: PLC0415 - the help needs none of it

    with output(quiet=quiet):
        run_router(load_settings(RouterSettings, config), duration, insecure)
