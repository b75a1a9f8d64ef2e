"""`forefeel investigate`."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import (
    AsJson,
    ForceColumn,
    Insecure,
    PositionColumn,
    Quiet,
    ResultsFolder,
    RowRate,
    TimeColumn,
    examples,
    number,
)
from forefeel.common.errors import ConfigurationError
from forefeel.terminal import output


@examples(
    "forefeel investigate run.csv --out out/ask",
    "forefeel investigate run.csv answer.csv --out out/ask",
    "forefeel investigate run.csv --workspace 0,0.03 --max-speed 0.05 --max-acceleration 1 --max-force 2",
    "forefeel investigate --config slave.yaml --virtual-time --out out/ask",
    "forefeel investigate --config master.yaml --out out/ask",
)
def investigate(  # noqa: PLR0913, PLR0917 - one parameter per option
    files: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[QUESTION [ANSWER]]", help="A recording, and the one that was asked for."),
    ] = None,
    out: ResultsFolder = None,
    config: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Of the master: move a live cell; of a slave with --virtual-time."),
    ] = None,
    virtual_time: Annotated[
        bool, typer.Option("--virtual-time", help="Move the simulated axis of the slave's settings.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Ask nothing before a live axis moves.")] = False,
    insecure: Insecure = False,
    seconds: Annotated[float, number("S", 10.0, 60.0, "Of the motion.")] = 20.0,
    workspace: Annotated[
        str | None, typer.Option(metavar="M,M", help="Its range; default: what QUESTION has reached.")
    ] = None,
    max_speed: Annotated[float | None, number("M/S", 1e-9, 1e3, "Default: as reached.")] = None,
    max_acceleration: Annotated[float | None, number("M/S2", 1e-9, 1e6, "Default: as reached.")] = None,
    max_force: Annotated[float | None, number("N", 1e-9, 1e6, "At which the bench stops it.")] = None,
    axis: Annotated[str | None, typer.Option(metavar="NAME", help="Of an MCAP file with several.")] = None,
    overwrite: Annotated[bool, typer.Option(help="Replace earlier results in DIR.")] = False,
    as_is: Annotated[bool, typer.Option("--as-is", help="Ask nothing about units.")] = False,
    time_column: TimeColumn = None,
    position_column: PositionColumn = None,
    force_column: ForceColumn = None,
    row_rate: RowRate = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.common.recording.units import Mapping  # noqa: PLC0415 - the help needs none of it
    from forefeel.investigation.run import InvestigationOptions, run_investigation, run_on_bench  # noqa: PLC0415
    from forefeel.results.task import usable_recording  # noqa: PLC0415

    limits = {"speed_m_s": max_speed, "acceleration_m_s2": max_acceleration, "force_n": max_force}
    limits |= dict(zip(("low_m", "high_m"), _range_m(workspace), strict=False))
    given = {key: value for key, value in limits.items() if value is not None}
    columns = Mapping(time_column, position_column, force_column, row_rate)
    read = partial(usable_recording, columns=columns, axis=axis, as_is=as_is)
    options = InvestigationOptions(read, seconds, given, overwrite, yes)
    with output(as_json, quiet):
        if config is None:
            if not files or virtual_time:
                raise ConfigurationError("expected a recording, or --config FILE")
            run_investigation(files, out, options)
            return
        question, more = (files[0], files[1:]) if files else (None, [])
        if more:
            raise ConfigurationError(f"{more[0]}: expected no answer, the bench of --config makes it")
        from forefeel.investigation.bench import bench_of  # noqa: PLC0415

        run_on_bench(bench_of(config, virtual_time, axis, insecure), question, out or Path("asked"), options)


def _range_m(text: str | None) -> tuple[float, ...]:
    """Parses `--workspace` to (low, high) in m, None to (). ConfigurationError: no two rising numbers."""
    if text is None:
        return ()
    try:
        low_m, high_m = map(float, text.split(","))
    except ValueError:
        low_m = high_m = 0.0
    if not low_m < high_m:
        raise ConfigurationError(f"--workspace {text}: expected two numbers in m, the larger last, as 0,0.03")
    return low_m, high_m
