"""`forefeel view`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.dashboard import PACKAGES, Address, Open, Port, Vessel
from forefeel.commands.options import Quiet, examples, extra
from forefeel.terminal import output


@examples("forefeel view out/demo/recording.mcap --open")
def view(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recorded run (MCAP).")],
    address: Address = "127.0.0.1",
    port: Port = 8600,
    opens: Open = False,
    vessel: Vessel = None,
    quiet: Quiet = False,
) -> None:
    from forefeel.report.vessel import vessel_of  # noqa: PLC0415 - the help needs none of it

    drawn = vessel_of(vessel)
    with extra("dashboard", *PACKAGES):
        from forefeel.dashboard.server import run_view  # noqa: PLC0415
    with output(quiet=quiet):
        run_view(file, address, port, opens, drawn)
