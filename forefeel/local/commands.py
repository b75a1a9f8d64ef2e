"""`forefeel clear`, `forefeel audit`: acts of a person beside a daemon; `forefeel estop` as typer sees it."""

import json
import os
from collections.abc import Callable
from inspect import Parameter, Signature
from optparse import OptionParser
from pathlib import Path
from typing import Annotated

import typer

from forefeel.common.audit import is_hash
from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.state.folder import AUDIT, state_path
from forefeel.daemon_settings import load_daemon
from forefeel.local.audit_text import (
    describe,
    describe_heads,
    entry_text,
    heads_noted_in,
    missing_heads,
    read_entries,
    read_verdict,
    verdict_json,
)
from forefeel.local.client import NobodyThereError, ask
from forefeel.local.protocol import Answer, Request
from forefeel.options import AsJson, Quiet
from forefeel.terminal import answer, output

audit_app = typer.Typer(help="The audit log of a daemon.", no_args_is_help=True)
CLEAR_EPILOG = "Example: forefeel clear --config deploy/config/slave.yaml"

LogFile = Annotated[Path, typer.Argument(metavar="FILE", help="STATE/audit.jsonl of a daemon.")]


def clear(
    config: Annotated[Path, typer.Option(metavar="FILE", help="The slave's YAML file.")],
    axis: Annotated[str | None, typer.Option(help="This one and those that stopped with it.")] = None,
) -> None:
    """Clear a latched emergency stop or fault: on the slave's host only, while the slave runs."""
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


def typed(parser: OptionParser, act: Callable[..., None]) -> Callable[..., None]:
    """`act` as a command of typer with the parser's options: for help, completion and reference."""

    def command(**options: object) -> None:
        act(**options)

    kinds = {"store": str | None, "append": list[str] | None, "store_true": bool}
    parameters = [
        Parameter(
            each.dest,
            Parameter.KEYWORD_ONLY,
            default=parser.defaults[each.dest],
            annotation=Annotated[
                kinds[each.action], typer.Option(each.get_opt_string(), metavar=each.metavar, help=each.help)
            ],
        )
        for each in parser.option_list
        if each.dest
    ]
    setattr(command, "__signature__", Signature(parameters))  # noqa: B010 - of no type that has it
    command.__doc__ = parser.description
    return command


@audit_app.command("verify", epilog="Example: forefeel audit verify state/audit.jsonl")
def audit_verify(
    file: LogFile,
    head: Annotated[str | None, typer.Option(metavar="HASH", help="Of an entry that must be there.")] = None,
    peer_log: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Audit log of the other end, which noted this one's.")
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Check the hash chain: exit 0 intact, 1 not."""
    if head is not None and not is_hash(head):
        raise ConfigurationError(f"--head {head}: expected 64 hexadecimal digits, as an entry's hash has")
    verdict = read_verdict(file, head)
    noted = [] if peer_log is None else heads_noted_in(peer_log)
    missing = missing_heads(file, noted)
    good = verdict.intact and not missing and (head is None or verdict.head_at is not None)
    with output(as_json, quiet):
        answer(
            *describe(verdict, head),
            *([] if peer_log is None else describe_heads(noted, missing)),
            document=lambda: {
                "intact": good, **verdict_json(verdict), "missing": [each._asdict() for each in missing],
            },
        )  # fmt: skip
    if not good:
        raise typer.Exit(1)


@audit_app.command("show", epilog="Example: forefeel audit show state/audit.jsonl")
def audit_show(file: LogFile, as_json: AsJson = False) -> None:
    """Print the entries, one line each, as far as the chain is intact; exit 1 where it is not."""
    entries, flaw = read_entries(file)
    for entry in entries:
        typer.echo(json.dumps(entry.noted._asdict()) if as_json else entry_text(entry))
    if flaw is not None:
        raise RunError(f"{file}:{flaw.line}: the line {flaw.what}")


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
