"""Options that several commands have."""

from typing import Annotated

import typer

ThroughRouter = Annotated[bool, typer.Option("--through-router", help="What it connects to is a router.")]
Strands = Annotated[
    int, typer.Option("--strands", min=1, max=16, help="Connections of each daemon, as they have it.")
]
Insecure = Annotated[bool, typer.Option("--insecure", help="Do without certificates outside this host.")]
Duration = Annotated[
    float | None, typer.Option("--duration", min=0.0, help="End after this many seconds.", metavar="S")
]
