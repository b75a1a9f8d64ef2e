"""`forefeel resimulate`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import AsJson, Quiet, examples, number
from forefeel.terminal import output


@examples(
    "forefeel resimulate out/run/recording.mcap",
    "forefeel resimulate monday.mcap tuesday.mcap --no-worse 1.02",
)
def resimulate(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Recorded sessions (MCAP).")],
    require_identical: Annotated[
        bool,
        typer.Option("--require-identical", help="Exit 1 unless each prediction is equal bit for bit."),
    ] = False,
    no_worse: Annotated[
        float | None,
        number("RATIO", 0.0, 1e3, "Exit 1 where rms now is over RATIO times rms then, e.g. 1.02."),
    ] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.resimulate.compare import run_resimulation  # noqa: PLC0415 - the help needs none of it

    with output(as_json, quiet):
        run_resimulation(files, require_identical, no_worse)
