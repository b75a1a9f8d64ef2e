"""`forefeel ros`."""

from pathlib import Path
from typing import Annotated

import typer

from forefeel.commands.options import (
    Connect,
    Duration,
    Insecure,
    ObservedCell,
    ObserverConfig,
    ObserverPki,
    Quiet,
    ThroughRouter,
    examples,
    extra,
)
from forefeel.common.errors import ConfigurationError
from forefeel.terminal import output

_LAST_DOMAIN = 232  # whose ports are below 65536 (RTPS 2.3, 9.6.1)


@examples(
    "forefeel ros --cell cathlab --connect tls/10.0.0.1:7447 --connect tls/10.0.0.2:7448 --pki pki",
    "forefeel ros --config viewer.yaml --zenoh tcp/127.0.0.1:7447",
    "forefeel ros --config viewer.yaml --zenoh tcp/127.0.0.1:7447 --accept-commands",
)
def ros(  # noqa: PLR0913, PLR0917 - one parameter per option
    connect: Connect = None,
    cell: ObservedCell = None,
    config: ObserverConfig = None,
    pki: ObserverPki = None,
    through_router: ThroughRouter = False,
    insecure: Insecure = False,
    zenoh: Annotated[
        str | None,
        typer.Option("--zenoh", metavar="ENDPOINT", help="Router of rmw_zenoh's nodes (rmw_zenohd)."),
    ] = None,
    dds: Annotated[
        bool, typer.Option("--dds", help="For nodes of Fast DDS, Cyclone DDS; default without --zenoh.")
    ] = False,
    domain: Annotated[
        int, typer.Option(envvar="ROS_DOMAIN_ID", min=0, max=_LAST_DOMAIN, help="Of the nodes.")
    ] = 0,
    humble: Annotated[bool, typer.Option("--humble", help="For rmw_zenoh of Humble.")] = False,
    rate: Annotated[float, typer.Option(min=1, max=1000, metavar="HZ", help="Of each topic.")] = 200.0,
    accept_commands: Annotated[
        bool, typer.Option("--accept-commands", help="Over Zenoh: state_command pause, and servo_jp.")
    ] = False,
    servo: Annotated[
        list[str] | None,
        typer.Option(metavar="AXIS=SOCKET", help="Which handle servo_jp moves, of driver servo; repeat it."),
    ] = None,
    duration: Duration = None,
    quiet: Quiet = False,
) -> None:
    """Publishers are reliable, volatile and keep the last 100, so that readers of either reliability match. A
    reader that asks for transient local is named: over Zenoh it hears what comes from then on, over DDS
    nothing.
    """
    from forefeel.network_settings import observer  # noqa: PLC0415
    from forefeel.ros.bridge import RosOptions, run_ros  # noqa: PLC0415 - the help needs none of it

    dds = dds or zenoh is None
    sockets = _sockets(servo or [], accept_commands)
    if accept_commands and zenoh is None:
        raise ConfigurationError("--accept-commands: commands come over Zenoh alone; expected --zenoh, too")
    if dds:
        with extra("ros", "rosless"):
            import rosless  # noqa: F401, PLC0415 - an extra
    settings = observer(config, cell, connect or [], pki, through_router)
    options = RosOptions(domain, rate, dds, zenoh, humble, accept_commands, sockets)
    with output(quiet=quiet):
        run_ros(settings, options, duration, insecure)


def _sockets(given: list[str], accept_commands: bool) -> dict[str, Path]:
    """Parses `AXIS=SOCKET` to paths by axis. ConfigurationError: malformed, or commands are not accepted."""
    if given and not accept_commands:
        raise ConfigurationError("--servo: expected --accept-commands, too")
    for text in given:
        if not all(text.partition("=")):
            raise ConfigurationError(f"--servo {text}: expected AXIS=SOCKET")
    return {axis: Path(path) for axis, _, path in (text.partition("=") for text in given)}
