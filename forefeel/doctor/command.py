"""`forefeel doctor`: looks, prints, tells the exit code."""

import json
import os
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import typer
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from forefeel.doctor.examine import examine
from forefeel.doctor.findings import LEVELS, Finding, worst

SCHEMA = "forefeel.doctor/1"
_PLAIN_WIDTH = 160
_STYLES = {"green": "green", "amber": "yellow", "red": "bold red"}


def run_doctor(files: Sequence[Path], as_json: bool) -> None:
    """Looks at this host and prints what was found.

    Raises:
        ConfigurationError: a file is not there, or two are of one role. typer.Exit: 1 when something is red.
    """
    terminal = sys.stderr.isatty()
    console = Console(stderr=True, highlight=False, markup=False)
    with console.status("looking") if terminal else _Silent() as status:
        findings = examine(files, status.update, os.environ)
    if as_json:
        print(json.dumps(document(findings), indent=2))
    else:
        _show(findings)
    if worst(findings) == "red":
        raise typer.Exit(1)


def document(findings: Sequence[Finding]) -> dict[str, object]:
    """The findings for programs."""
    counts = Counter(each.level for each in findings)
    return {
        "schema": SCHEMA,
        "worst": worst(findings),
        "counts": {level: counts[level] for level in LEVELS},
        "findings": [asdict(each) for each in findings],
    }


class _Silent:
    """In place of the line that says what is being done, where nobody watches."""

    def __enter__(self) -> "_Silent":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def update(self, text: str) -> None:
        """Says nothing."""


def _show(findings: Sequence[Finding]) -> None:
    terminal = sys.stdout.isatty()
    table = Table(box=box.SIMPLE_HEAD if terminal else box.ASCII2)
    for name in ("", "group", "what", "found", "what to do"):
        table.add_column(name, overflow="fold")
    for each in findings:
        level = Text(each.level, _STYLES[each.level])
        table.add_row(level, Text(each.group), Text(each.subject), Text(each.found), Text(each.advice))
    console = Console(highlight=False, markup=False, width=None if terminal else _PLAIN_WIDTH)
    console.print(table)
    counts = Counter(each.level for each in findings)
    console.print(", ".join(f"{counts[level]} {level}" for level in LEVELS))
