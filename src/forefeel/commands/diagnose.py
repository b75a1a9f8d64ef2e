"""`forefeel diagnose`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import (
    AsJson,
    ForceColumn,
    PositionColumn,
    Quiet,
    ResultsFolder,
    RowRate,
    TimeColumn,
    examples,
)
from forefeel.terminal import output


@examples(
    "forefeel diagnose run.csv",
    "forefeel diagnose seal.csv --time ms:t --position mm:laser --force N:load --out out/seal",
    "forefeel diagnose monday.csv tuesday.csv --together --out out/bench",
    "forefeel diagnose monday.csv --confirm tuesday.csv --out out/bench",
    "forefeel diagnose recordings --jobs 4 --out out/all",
    "forefeel diagnose recordings --scheduler tcp://10.0.0.2:8786 --out out/all",
)
def diagnose(  # noqa: PLR0913, PLR0917 - one parameter per option
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE|DIR", help="A recording (CSV, Parquet, MCAP), or a folder of them."),
    ],
    out: ResultsFolder = None,
    model: Annotated[
        Path | None, typer.Option(metavar="FILE", help="model.yaml of the simulation that is compared.")
    ] = None,
    together: Annotated[
        bool, typer.Option("--together", help="One answer to several recordings of one bench.")
    ] = False,
    confirm: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Hold the model against another recording.")
    ] = None,
    jobs: Annotated[int, typer.Option(metavar="N", min=1, help="Recordings of DIR at a time.")] = 1,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Of a dask cluster that does DIR (forefeel[cluster])."),
    ] = None,
    axis: Annotated[str | None, typer.Option(metavar="NAME", help="Of an MCAP file with several.")] = None,
    replay: Annotated[
        bool, typer.Option(help="Predict the force 300 ms ahead where a cause is named.")
    ] = True,
    page: Annotated[bool, typer.Option(help="Draw report.html.")] = True,
    overwrite: Annotated[bool, typer.Option(help="Replace an earlier diagnosis in DIR.")] = False,
    as_is: Annotated[bool, typer.Option("--as-is", help="Ask nothing about units.")] = False,
    time_column: TimeColumn = None,
    position_column: PositionColumn = None,
    force_column: ForceColumn = None,
    row_rate: RowRate = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.common.model_file import load_model  # noqa: PLC0415 - the help needs none of it
    from forefeel.common.recording.units import Mapping  # noqa: PLC0415
    from forefeel.results.run import run_diagnosis  # noqa: PLC0415
    from forefeel.results.task import Task  # noqa: PLC0415

    with output(as_json, quiet):
        columns = Mapping(time_column, position_column, force_column, row_rate)
        given = load_model(model) if model else None
        task = Task(files[0], (), columns, axis, given, replay, page, as_is, confirm)
        run_diagnosis(files, out, task, together, jobs, scheduler, overwrite)
