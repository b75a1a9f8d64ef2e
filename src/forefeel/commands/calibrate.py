"""`forefeel calibrate`: load cells and stages."""

from os.path import relpath
from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import AsJson, Quiet, examples, number
from forefeel.terminal import output, say, suggest

ConfigFile = Annotated[Path, typer.Option("--config", metavar="FILE", help="The slave's YAML file.")]
Axis = Annotated[str, typer.Option("--axis", metavar="NAME", help="Which axis of it.")]
Out = Annotated[Path, typer.Option("--out", metavar="FILE", help="The calibration, .yaml.")]
Yes = Annotated[bool, typer.Option("--yes", help="Ask nothing; else Enter is read from stdin.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace FILE.")]
ValidDays = Annotated[
    int, typer.Option("--valid-days", metavar="N", min=1, max=3650, help="How long it holds.")
]


@examples(
    "forefeel calibrate load-cell --config slave.yaml --axis insertion --weights 0,0.05,0.1,0.2 "
    "--out load_cell.yaml",
)
def load_cell(  # noqa: PLR0913, PLR0917 - one parameter per option
    config: ConfigFile,
    axis: Axis,
    out: Out,
    weights: Annotated[
        str | None, typer.Option(metavar="KG,...", help="Weights in kg, each is applied up and down.")
    ] = None,
    forces: Annotated[
        str | None,
        typer.Option(metavar="N,...", help="Forces in N in their place; positive resists insertion."),
    ] = None,
    yes: Yes = False,
    overwrite: Overwrite = False,
    settle: Annotated[float, number("S", 0.0, 60.0, "Wait after a load was changed.")] = 1.0,
    max_residual: Annotated[
        float, number("SHARE", 1e-6, 0.1, "Of the range, rms of what the line leaves.")
    ] = 0.01,
    valid_days: ValidDays = 365,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.calibrate.procedure import Target, run_load_cell  # noqa: PLC0415 - the help needs none of it

    with output(as_json, quiet):
        run_load_cell(
            Target(config, axis, out, yes, overwrite, valid_days),
            weights,
            forces,
            settle_s=settle,
            residual_share=max_residual,
        )
        _say_where_it_belongs(config, axis, "load_cell", out)


@examples("forefeel calibrate stage --config slave.yaml --axis insertion --out stage.yaml")
def stage(  # noqa: PLR0913, PLR0917 - one parameter per option
    config: ConfigFile,
    axis: Axis,
    out: Out,
    yes: Yes = False,
    overwrite: Overwrite = False,
    velocity: Annotated[float, number("M/S", 1e-4, 0.05, "From end to end.")] = 0.005,
    valid_days: ValidDays = 365,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.calibrate.procedure import Target, run_stage  # noqa: PLC0415

    with output(as_json, quiet):
        run_stage(Target(config, axis, out, yes, overwrite, valid_days), velocity)
        _say_where_it_belongs(config, axis, "stage", out)


def _say_where_it_belongs(config: Path, axis: str, slot: str, out: Path) -> None:
    say(f"write into {config}, axis {axis}: {slot}: {{calibration: {relpath(out, config.parent)}}}")
    suggest("device", "probe", config=config)
