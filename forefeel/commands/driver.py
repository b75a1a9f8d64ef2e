"""`forefeel driver`: the drivers that are installed."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import AsJson, Quiet, examples
from forefeel.terminal import output


@examples(
    "forefeel driver test zaber_ascii",
    "forefeel driver test ascii_line --config slave.yaml",
    "forefeel driver test zaber_ascii --config slave.yaml --moves",
)
def test(
    name: Annotated[str, typer.Argument(metavar="NAME", help="As it stands at `driver:` in the YAML file.")],
    config: Annotated[
        Path | None, typer.Option("--config", metavar="FILE", help="YAML of a real device, not the emulator.")
    ] = None,
    axis: Annotated[str | None, typer.Option("--axis", metavar="NAME", help="Axis of that file.")] = None,
    moves: Annotated[
        bool, typer.Option("--moves", help="A real stage may move by 1 mm, a real handle push; asks first.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Without a file the driver talks to its emulator, which is frozen, unplugged and told to fail."""
    from forefeel.conformance.run import DriverTestOptions, run_driver_test  # noqa: PLC0415

    with output(as_json, quiet):
        run_driver_test(DriverTestOptions(name, config, axis, moves, yes))
