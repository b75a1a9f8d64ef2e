"""`forefeel clear`."""

import os
from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import examples
from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.state.folder import AUDIT, state_path
from forefeel.daemon_settings import load_daemon
from forefeel.local.audit_text import read_entries
from forefeel.local.client import NobodyThereError, ask
from forefeel.local.protocol import Answer, Request


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
    except NobodyThereError as error:
        raise RunError(f"not cleared: {error}; {_last_words(folder)}") from error
    _say(answer)
    if not answer.done:
        raise typer.Exit(1)


def _last_words(folder: Path) -> str:
    """How the daemon ended, by its audit log."""
    path = folder / AUDIT
    if not path.exists():
        return "expected a slave that runs"
    entries, _ = read_entries(path)
    last = entries[-1].noted if entries else None
    if last is None or last.event != "stop":
        return "the slave was killed; a new start waits for a session, an emergency stop stays latched"
    return f"the slave ended at {last.utc}: {last.details.get('reason')}; start it again"


def _say(answer: Answer) -> None:
    for line in answer.text:
        typer.echo(f"{answer.role}: {line}")
