"""`forefeel demo`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.dashboard import Open, Port
from forefeel.commands.options import Quiet, examples
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
    from forefeel.demo import run_demo  # noqa: PLC0415 - the help needs none of it

    with output(quiet=quiet):
        run_demo(out, seed, port, opens)
