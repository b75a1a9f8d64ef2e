"""`forefeel simulate`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import PositionColumn, Quiet, examples
from forefeel.terminal import output


@examples(
    "forefeel simulate --model model.yaml --motion hand --duration 30 --seed 1 --out run.csv",
    "forefeel simulate --model model.yaml --motion seal_o_ring_1bar.csv --noise 0 --out seal.parquet",
)
def simulate(  # noqa: PLR0913, PLR0917 - one parameter per option
    model: Annotated[Path, typer.Option(metavar="FILE", help="model.yaml: the contact and its sensor.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="A .csv or .parquet file.")],
    motion: Annotated[
        str,
        typer.Option(
            metavar="MOTION",
            help="hand, multisine, sine, or a recording to follow.",
        ),
    ] = "hand",
    duration: Annotated[
        float | None, typer.Option(metavar="S", help="Default 30, or the recording's.")
    ] = None,
    rate: Annotated[
        float | None, typer.Option(metavar="HZ", help="Default 1000, or the recording's stamps.")
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of the motion and the noise.")] = 0,
    start: Annotated[float, typer.Option(metavar="M", help="Position where the motion begins.")] = 0.0,
    depth: Annotated[float, typer.Option(metavar="M", help="How far it goes from there.")] = 0.03,
    frequency: Annotated[float, typer.Option(metavar="HZ", help="Of the sine.")] = 0.5,
    noise: Annotated[float, typer.Option(metavar="N", help="Standard deviation of the force.")] = 0.002,
    noise_corner: Annotated[
        float | None, typer.Option(metavar="HZ", help="Corner of AR(1) noise; white without.")
    ] = None,
    full_scale: Annotated[
        float | None, typer.Option(metavar="N", help="Range of the load cell, 16 bits; endless without.")
    ] = None,
    encoder_step: Annotated[float, typer.Option(metavar="M", help="Of the position; 0: none.")] = 1e-6,
    overwrite: Annotated[bool, typer.Option(help="Replace FILE.")] = False,
    time_column: Annotated[
        str | None, typer.Option("--time", metavar="UNIT:COLUMN", help="Of the recording to follow.")
    ] = None,
    position_column: PositionColumn = None,
    quiet: Quiet = False,
) -> None:
    from forefeel.simulate.run import SimulationOptions, run_simulation  # noqa: PLC0415 - the help needs none of it
    from forefeel.simulate.sensor import SensorOptions  # noqa: PLC0415

    sensor = SensorOptions(noise, noise_corner, full_scale, encoder_step)
    columns = time_column, position_column
    options = SimulationOptions(model, motion, duration, rate, seed, start, depth, frequency, sensor, columns)
    with output(quiet=quiet):
        run_simulation(options, out, overwrite)
