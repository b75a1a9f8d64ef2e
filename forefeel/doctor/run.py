"""`forefeel doctor`: looks, prints, tells the exit code."""

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import typer
from rich.table import Table
from rich.text import Text

from forefeel.doctor.examine import examine
from forefeel.doctor.findings import LEVELS, Finding, worst
from forefeel.terminal import SHADES, answer, stages, table

SCHEMA = "forefeel.doctor/1"


def run_doctor(files: Sequence[Path]) -> None:
    """Looks at this host and answers what was found.

    Raises:
        ConfigurationError: a file is not there, or two are of one role. typer.Exit: 1 when something is red.
    """
    with stages("looking", said=()) as tell:
        findings = examine(files, tell, os.environ)
    counts = Counter(each.level for each in findings)
    summary = ", ".join(f"{counts[level]} {level}" for level in LEVELS)
    answer(_table(findings), summary, document=lambda: document(findings))
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


def _table(findings: Sequence[Finding]) -> Table:
    made = table("", "group", "what", "found", "what to do")
    for each in findings:
        level = Text(each.level, SHADES[each.level])
        made.add_row(level, Text(each.group), Text(each.subject), Text(each.found), Text(each.advice))
    return made
