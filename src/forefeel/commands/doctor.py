"""`forefeel doctor`."""

import os
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import AsJson, Quiet, examples
from forefeel.daemon_settings import load_daemon
from forefeel.terminal import SHADES, answer, output, say, suggest, table


@examples(
    "forefeel doctor --config deploy/config/slave.yaml",
    "forefeel doctor --config slave.yaml --config master.yaml --json",
)
def doctor(
    config: Annotated[
        list[Path] | None,
        typer.Option("--config", metavar="FILE", help="A slave's or master's YAML file; one of each."),
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    from rich.text import Text  # noqa: PLC0415 - the help needs none of it

    from forefeel.doctor.checks import LEVELS, examine  # noqa: PLC0415
    from forefeel.doctor.host import HostProbe  # noqa: PLC0415

    with output(as_json, quiet):
        findings = examine(config or [], HostProbe(), say, os.environ)
        counts = {level: Counter(finding.level for finding in findings)[level] for level in LEVELS}
        worst = next((level for level in reversed(LEVELS) if counts[level]), "green")
        shown = table("", "group", "what", "found", "what to do")
        for finding in findings:
            words = map(Text, (finding.group, finding.subject, finding.found, finding.advice))
            shown.add_row(Text(finding.level, SHADES[finding.level]), *words)
        document = {
            "schema": "forefeel.doctor/1",
            "worst": worst,
            "counts": counts,
            "findings": [asdict(finding) for finding in findings],
        }
        answer(shown, ", ".join(f"{n} {level}" for level, n in counts.items()), document=lambda: document)
        if worst == "red":
            suggest("doctor", head="when that is mended", config=config)
            raise typer.Exit(1)
        if config:
            suggest(load_daemon(config[0]).role, config=config[0])
        else:
            suggest("loopback", impairment="paper")
