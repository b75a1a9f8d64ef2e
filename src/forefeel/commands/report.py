"""`forefeel report`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import AsJson, Quiet, ResultsFolder, examples
from forefeel.terminal import output


@examples("forefeel report run.mcap --out out/report")
def report(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recorded run (MCAP).")],
    out: ResultsFolder = None,
    overwrite: Annotated[bool, typer.Option(help="Replace an earlier report in DIR.")] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.report.page import run_report  # noqa: PLC0415 - the help needs none of it

    with output(as_json, quiet):
        run_report(file, out, overwrite)
