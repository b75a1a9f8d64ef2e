"""The commands, and where tests find them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer

from forefeel import cli

COMMANDS = [name.split() for name in cli.COMMANDS]
ROOT = Path(__file__).parents[2]


def contents(folder: Path) -> dict[Path, bytes | None]:
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def group(path: Sequence[str]) -> Any:  # noqa: ANN401 - typer's own command class, private to it
    """The command at that path of the command tree."""
    command: Any = typer.main.get_command(cli.app)
    for name in path:
        command = command.commands[name]
    return command
