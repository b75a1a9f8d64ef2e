"""`forefeel simulate`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import PositionColumn, Quiet, examples, number
from forefeel.terminal import output, suggest


@examples(
    "forefeel simulate --model catheter --motion hand --duration 30 --seed 1 --out run.csv",
    "forefeel simulate --model model.yaml --motion seal_o_ring_1bar.csv --noise 0 --out seal.parquet",
)
def simulate(  # noqa: PLR0913, PLR0917 - one parameter per option
    model: Annotated[
        Path, typer.Option(metavar="FILE", help="model.yaml: contact and sensor; or catheter, guidewire.")
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", help="A .csv or .parquet file.")],
    motion: Annotated[
        str,
        typer.Option(
            metavar="MOTION",
            help="hand, multisine, sine, or a recording to follow.",
        ),
    ] = "hand",
    duration: Annotated[float | None, number("S", 0.01, 86_400.0, "Default 30, or the recording's.")] = None,
    rate: Annotated[
        float | None, number("HZ", 1.0, 10_000.0, "Of the samples; default 1000, or the recording's.")
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Seed of the motion and the noise.")] = 0,
    start: Annotated[float, number("M", -10.0, 10.0, "Position where the motion begins.")] = 0.0,
    depth: Annotated[float, number("M", 1e-6, 10.0, "How far it goes from there.")] = 0.03,
    frequency: Annotated[float, number("HZ", 1e-3, 1000.0, "Of the sine.")] = 0.5,
    noise: Annotated[float, number("N", 0.0, 1e3, "Standard deviation of the force.")] = 0.002,
    encoder_step: Annotated[float, number("M", 0.0, 1e-2, "Of the position; 0: none.")] = 1e-6,
    overwrite: Annotated[bool, typer.Option(help="Replace FILE.")] = False,
    time_column: Annotated[
        str | None, typer.Option("--time", metavar="UNIT:COLUMN", help="Of the recording to follow.")
    ] = None,
    position_column: PositionColumn = None,
    quiet: Quiet = False,
) -> None:
    from forefeel.simulate.run import SimulationOptions, run_simulation  # noqa: PLC0415 - the help needs none of it

    columns = time_column, position_column
    options = SimulationOptions(
        model, motion, duration, rate, seed, start, depth, frequency, noise, encoder_step, columns
    )
    with output(quiet=quiet):
        run_simulation(options, out, overwrite)
        suggest("diagnose", out, overwrite=overwrite)
