"""The commands, and where tests find them."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
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


def refused(
    run: Callable[[Sequence[str]], int],
    capsys: pytest.CaptureFixture[str],
    folder: Path,
    line: str,
    words: Sequence[str],
    files: dict[str, str],
) -> None:
    """The line, with `@` for the folder of these files, exits with 2, says one line and leaves nothing."""
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    before = contents(folder)
    assert run(line.replace("@", str(folder)).split()) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("forefeel: ")
    assert shown.err.count("\n") == 1
    for word in words:
        assert word in shown.err
    assert contents(folder) == before
