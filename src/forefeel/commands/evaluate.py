"""`forefeel evaluate`."""

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
from forefeel.terminal import output, say, suggest


@examples(
    "forefeel evaluate seal_o_ring_1bar.csv presliding_friction.csv --delays 20:600 --out out/real",
    "forefeel evaluate run.csv --time ms:t --position mm:laser --force N:load",
)
def evaluate(  # noqa: PLR0913, PLR0917 - one parameter per option
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Recordings: CSV, Parquet, MCAP.")],
    out: ResultsFolder = None,
    delays: Annotated[
        str, typer.Option(metavar="MS", help="From a motion to the arrival of its force; or a range, 20:600.")
    ] = "300",
    jitter: Annotated[
        float, typer.Option(metavar="MS", help="Each force is up to this earlier or later.")
    ] = 0.0,
    loss: Annotated[float, typer.Option(metavar="P", help="Probability that a force never arrives.")] = 0.0,
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of jitter and loss.")] = 0,
    model: Annotated[
        Path | None, typer.Option(metavar="FILE", help="model.yaml for the forefeel method.")
    ] = None,
    axis: Annotated[str | None, typer.Option(metavar="NAME", help="Of an MCAP file with several.")] = None,
    overwrite: Annotated[bool, typer.Option(help="Replace an earlier evaluation in DIR.")] = False,
    rules: Annotated[bool, typer.Option("--rules", help="Print the rules of the comparison, too.")] = False,
    time_column: TimeColumn = None,
    position_column: PositionColumn = None,
    force_column: ForceColumn = None,
    row_rate: RowRate = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.common.recording.units import Mapping  # noqa: PLC0415 - the help needs none of it
    from forefeel.diagnosis.evaluation.delays import delayed_links, most_usual  # noqa: PLC0415
    from forefeel.diagnosis.evaluation.evaluate import rules as stated  # noqa: PLC0415
    from forefeel.evaluation.run import run_evaluation  # noqa: PLC0415

    links = delayed_links(delays, 1e-3 * jitter, loss, seed)
    with output(as_json, quiet):
        columns = Mapping(time_column, position_column, force_column, row_rate)
        loaded = run_evaluation(files, links, model, columns, axis, out, overwrite)
        for rule in stated(most_usual(links), loaded) if rules else ():
            say(rule)
        if loaded is None:
            suggest("diagnose", files[0], axis=axis, out=out, **columns.options())
        elif not loaded.columns and axis is None:  # a loopback has one axis
            suggest(
                "loopback", recording=files[0], impairment="paper", master_model=model, **columns.options()
            )
