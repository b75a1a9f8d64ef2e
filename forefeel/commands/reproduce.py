"""`forefeel reproduce`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import AsJson, Quiet, examples
from forefeel.terminal import output


@examples(
    "forefeel reproduce --out out/paper",
    "forefeel reproduce --out out/paper --overwrite --recordings measured",
)
def reproduce(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Figures, page and numbers go there.")],
    overwrite: Annotated[bool, typer.Option(help="Replace an earlier result in DIR.")] = False,
    recordings: Annotated[
        list[Path] | None,
        typer.Option(
            "--recordings",
            metavar="DIR",
            help="Measured recordings to compare on; repeat it. Default: the variable FOREFEEL_DATA.",
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, max=2**31 - 1, help="Seed of operator, world and network of the bench.")
    ] = 1,
    duration: Annotated[
        float,
        typer.Option(
            "--duration", min=6.0, max=600.0, metavar="S", help="Of each run of the simulated bench."
        ),
    ] = 16.0,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.studies.paper.run import run_reproduction  # noqa: PLC0415 - the help needs none of it

    with output(as_json, quiet):
        run_reproduction(out, overwrite, recordings or (), seed, duration)
