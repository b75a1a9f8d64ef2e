"""`forefeel audit`: the audit log of a daemon."""

import json
from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import AsJson, Quiet, examples
from forefeel.common.errors import ConfigurationError, RunError
from forefeel.common.events.audit import is_hash
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
from forefeel.terminal import answer, output

LogFile = Annotated[Path, typer.Argument(metavar="FILE", help="STATE/audit.jsonl of a daemon.")]


@examples("forefeel audit verify state/audit.jsonl")
def verify(
    file: LogFile,
    head: Annotated[str | None, typer.Option(metavar="HASH", help="Of an entry that must be there.")] = None,
    peer_log: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Audit log of the other end, which noted this one's.")
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
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


@examples("forefeel audit show state/audit.jsonl")
def show(file: LogFile, as_json: AsJson = False) -> None:
    entries, flaw = read_entries(file)
    for entry in entries:
        typer.echo(json.dumps(entry.noted._asdict()) if as_json else entry_text(entry))
    if flaw is not None:
        raise RunError(f"{file}:{flaw.line}: the line {flaw.what}")
