"""The page of every command with its arguments and options, from the typer app."""

from collections.abc import Iterator
from typing import Any

import typer

from docs.hooks.markdown import NOTE, code, table
from forefeel.cli import app

_HEAD = f"""{NOTE}
# Command line

Every command, from the app itself. Exit code 0: done; 1: the run failed; 2: the input was wrong, said in
one line. `forefeel --install-completion` completes commands in your shell.

> Research software, not a medical device.
"""


def commands() -> Iterator[tuple[str, Any]]:
    """Every command that does something with its words, `forefeel pki init`, in the order of the help."""
    yield from _leaves("forefeel", typer.main.get_command(app))


def page() -> str:
    """The page as Markdown."""
    return "\n".join([_HEAD, *(_section(words, command) for words, command in commands())])


def _leaves(words: str, command: Any) -> Iterator[tuple[str, Any]]:  # noqa: ANN401 - typer's own class
    subcommands = getattr(command, "commands", None)
    if subcommands is None:
        yield words, command
        return
    for name, each in subcommands.items():
        yield from _leaves(f"{words} {name}", each)


def _section(words: str, command: Any) -> str:  # noqa: ANN401 - typer's own class
    rows = [_row(parameter) for parameter in command.params if parameter.name != "help"]
    examples = "".join(f"{each.strip()}\n" for each in (command.epilog or "").split("Example: ")[1:])
    shown = f"\n```bash\n{examples}```\n" if examples else ""
    listed = table(["", "takes", "default", ""], rows) if rows else ""
    return f"## {words} {{ #{words.replace(' ', '-')} }}\n\n{(command.help or '').strip()}\n{shown}\n{listed}"


def _row(parameter: Any) -> list[str]:  # noqa: ANN401 - typer's own class
    argument = parameter.param_type_name == "argument"
    name = _metavar(parameter) if argument else ", ".join([*parameter.opts, *parameter.secondary_opts])
    takes = "" if argument or parameter.is_flag else code(_metavar(parameter))
    many = parameter.nargs == -1 or getattr(parameter, "multiple", False)
    return [
        code(name),
        ", ".join(filter(None, [takes, _range(parameter), "may be repeated" if many else ""])),
        _default(parameter),
        getattr(parameter, "help", None) or "",
    ]


def _metavar(parameter: Any) -> str:  # noqa: ANN401 - typer's own class
    return str(parameter.metavar or parameter.name.upper())


def _range(parameter: Any) -> str:  # noqa: ANN401 - typer's own class
    low, high = (getattr(parameter, name, None) for name in ("min", "max"))
    if low is None and high is None:
        return ""
    if low is None or high is None:
        return f"at most {high:g}" if low is None else f"at least {low:g}"
    return f"{low:g} to {high:g}"


def _default(parameter: Any) -> str:  # noqa: ANN401 - typer's own class
    if parameter.required:
        return "required"
    value = parameter.default
    if value is None or value is False or value in ((), [], "") or callable(value):
        return ""
    return code(value)
