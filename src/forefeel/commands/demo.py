"""`forefeel demo`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.dashboard import Open, Port
from forefeel.commands.options import Quiet, examples
from forefeel.files import fresh_folder
from forefeel.loopback.viewer import DashboardProcess
from forefeel.terminal import output


@examples("forefeel demo --open")
def demo(
    seed: Annotated[
        int, typer.Option(min=0, max=2**31 - 2, help="Seed of operator, world and impairment.")
    ] = 1,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Results; those of an earlier demo go.")] = Path(
        "out/demo"
    ),
    port: Port = 8600,
    opens: Open = False,
    quiet: Quiet = False,
) -> None:
    """About a minute and a half. Ctrl-C ends it."""
    with output(quiet=quiet):
        fresh_folder(out, (), "an earlier demo", overwrite=True)
        with DashboardProcess(out, opens, port=port) as viewer:
            viewer.serve()
            from forefeel.demo import run_demo  # noqa: PLC0415 - the page is there before all that it loads

            run_demo(viewer, out, seed)
