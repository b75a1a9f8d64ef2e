"""Whether words that somebody may type are a command of ours. Nothing is run."""

import re
import shlex
from collections.abc import Iterator
from functools import cache
from typing import Any

import typer

from forefeel.cli import app

_ASSIGNED = re.compile(r"\w+=\S*")


@cache
def tree() -> Any:  # noqa: ANN401 - typer's own class
    """The command `forefeel`, with its `commands`."""
    return typer.main.get_command(app)


def typed(shell: str) -> Iterator[list[str]]:
    """The words of each command line of ours in a shell block; its output and other programs are left out."""
    for line in shell.replace("\\\n", " ").splitlines():
        for part in re.split(r"&&|\|\|?|;", line.strip().removeprefix("$ ")):
            words = _words(part)
            while words and (words[0] == "sudo" or _ASSIGNED.fullmatch(words[0])):
                words = words[1:]
            if words and words[0].rpartition("/")[2] == "forefeel":
                yield words[1:]


def wrong(words: list[str], whole: bool = True) -> str | None:
    """What is wrong with the words behind `forefeel`; `whole`: what is required has to be there."""
    command = tree()
    while hasattr(command, "commands"):
        if not words:
            return "a command is missing" if whole else None
        if words[0].startswith("-"):
            return _unknown(command, words)
        if words[0] not in command.commands:
            return f"no command {words[0]}"
        command, words = command.commands[words[0]], words[1:]
    return _unknown(command, words) or (_missing(command, words) if whole else None)


def _words(text: str) -> list[str]:
    try:
        return shlex.split(text, comments=True)
    except ValueError:  # an apostrophe in what a command has said
        return []


def _options(command: Any) -> dict[str, Any]:  # noqa: ANN401 - typer's own class
    return {name: each for each in command.params for name in (*each.opts, *each.secondary_opts)}


def _split(command: Any, words: list[str]) -> tuple[list[str], list[str]]:  # noqa: ANN401
    """(options, arguments); the values of options are left out."""
    known, options, arguments, rest = _options(command), list[str](), list[str](), iter(words)
    for word in rest:
        if not re.match(r"--?[A-Za-z]", word):
            arguments.append(word)
            continue
        name, given, _ = word.partition("=")
        options.append(name)
        if name in known and not known[name].is_flag and not given:
            next(rest, None)
    return options, arguments


def _unknown(command: Any, words: list[str]) -> str | None:  # noqa: ANN401
    known = {*_options(command), "--help"}
    return next((f"no option {name}" for name in _split(command, words)[0] if name not in known), None)


def _missing(command: Any, words: list[str]) -> str | None:  # noqa: ANN401
    options, arguments = _split(command, words)
    if "--help" in options:
        return None
    kinds = [each for each in command.params if each.param_type_name == "argument"]
    needed = [each for each in command.params if each.required and each not in kinds]
    for each in needed:
        if not set(each.opts) & set(options):
            return f"{each.opts[0]} is missing"
    if len(arguments) < sum(each.required for each in kinds):
        return "an argument is missing"
    most = None if any(each.nargs == -1 for each in kinds) else len(kinds)
    return "an argument too many" if most is not None and len(arguments) > most else None
