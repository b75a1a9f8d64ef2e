"""`forefeel loopback`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import (
    AcceptPrior,
    AsJson,
    Duration,
    ForceColumn,
    PositionColumn,
    Quiet,
    RowRate,
    TimeColumn,
    examples,
)
from forefeel.common.errors import ConfigurationError
from forefeel.common.recording.units import Mapping
from forefeel.common.transport.settings import PRESETS
from forefeel.terminal import output


@examples(
    "forefeel loopback --impairment paper --duration 20 --out out/run",
    "forefeel loopback --recording seal_o_ring_1bar.csv --impairment paper",
    "forefeel loopback --slave-model world.yaml --hide friction.yaml --hide-at 5 --out out/run",
)
def loopback(  # noqa: PLR0913, PLR0917 - one parameter per option
    recording: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Play this recording (CSV, Parquet, MCAP).")
    ] = None,
    impairment: Annotated[
        str,
        typer.Option(metavar="PRESET", help=f"One of {', '.join(PRESETS)}."),
    ] = "none",
    duration: Duration = None,
    seed: Annotated[
        int, typer.Option(min=0, max=2**31 - 1, help="Seed of operator, world and impairment.")
    ] = 0,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Results; default out/run-DATE.")] = None,
    overwrite: Annotated[bool, typer.Option(help="Replace the results of an earlier run in DIR.")] = False,
    preset: Annotated[
        str | None,
        typer.Option(help="Simulated instrument: catheter (default) or guidewire."),
    ] = None,
    world: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="World of another engine (YAML); coronary and arch are vessels by MuJoCo."
        ),
    ] = None,
    virtual_time: Annotated[
        bool, typer.Option("--virtual-time", help="One process, as fast as it can, repeatable.")
    ] = False,
    slave_model: Annotated[
        Path | None, typer.Option(metavar="FILE", help="model.yaml of the simulated world.")
    ] = None,
    master_model: Annotated[
        Path | None, typer.Option(metavar="FILE", help="model.yaml of the predictor.")
    ] = None,
    prior_dir: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Start from what an earlier run learned of this instrument and patient, and keep what this "
            "one learns; DIR is made.",
        ),
    ] = None,
    patient: Annotated[
        str | None, typer.Option(metavar="NAME", help="With --prior-dir: the patient; default simulated.")
    ] = None,
    accept_prior: AcceptPrior = False,
    hide: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="model.yaml of effects that are added to the simulated world."),
    ] = None,
    hide_at: Annotated[
        float, typer.Option(metavar="S", help="When they are switched on, by the world's time.")
    ] = 0.0,
    hardware: Annotated[
        str,
        typer.Option(
            help="simulated, emulated-serial or emulated-can: devices as their bytes.",
        ),
    ] = "simulated",
    dashboard: Annotated[
        bool, typer.Option("--dashboard/--no-dashboard", help="Serve the live view while it runs.")
    ] = False,
    opens: Annotated[bool, typer.Option("--open", help="Open the live view in the browser.")] = False,
    time_column: TimeColumn = None,
    position_column: PositionColumn = None,
    force_column: ForceColumn = None,
    row_rate: RowRate = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.loopback.plan import LoopbackOptions  # noqa: PLC0415
    from forefeel.loopback.run import run_loopback  # noqa: PLC0415 - the help needs none of it

    columns = Mapping(time_column, position_column, force_column, row_rate)
    if columns != Mapping() and recording is None:
        given = (f"--{name} {value}" for name, value in columns.options().items() if value is not None)
        raise ConfigurationError(f"{' '.join(given)}: expected only with --recording")
    options = LoopbackOptions(
        seed=seed,
        impairment=impairment,
        preset=preset,
        world=world,
        duration_s=duration,
        recording=recording,
        columns=columns,
        slave_model=slave_model,
        master_model=master_model,
        prior_dir=prior_dir,
        patient=patient,
        accept_prior=accept_prior,
        hide=hide,
        hide_at_s=hide_at,
        hardware=hardware,
    )
    with output(as_json, quiet):
        run_loopback(options, out, overwrite, virtual_time, dashboard or opens, opens)
