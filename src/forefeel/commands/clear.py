"""`forefeel clear`."""

import os
from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import examples
from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.state.folder import state_path
from forefeel.daemon_settings import load_daemon
from forefeel.estop.client import Request, ask


@examples("forefeel clear --config deploy/config/slave.yaml")
def clear(
    config: Annotated[Path, typer.Option(metavar="FILE", help="The slave's YAML file.")],
    axis: Annotated[str | None, typer.Option(help="This one and those that stopped with it.")] = None,
) -> None:
    settings = load_daemon(config)
    if settings.model_dump(include={"role"}) != {"role": "slave"}:
        raise ConfigurationError(f"{config}: role = 'master': expected the slave's file, on its host")
    folder = state_path(settings, "slave", os.environ)
    try:
        answer = ask(folder, Request(do="clear", axis=axis))
    except RunError as error:
        raise RunError(f"not cleared: {error}; first: forefeel slave --config {config}") from error
    for line in answer.text:
        typer.echo(f"{answer.role}: {line}")
    if not answer.done:
        raise typer.Exit(1)
