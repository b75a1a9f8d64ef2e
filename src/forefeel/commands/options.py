"""Options that several commands have."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from forefeel.common.errors import ConfigurationError

Command = TypeVar("Command", bound=Callable[..., None])
_EXAMPLES: dict[Callable[..., None], tuple[str, ...]] = {}

DaemonConfig = Annotated[Path, typer.Option("--config", help="The daemon's YAML file.", metavar="FILE")]
Connect = Annotated[
    list[str] | None, typer.Option("--connect", metavar="ENDPOINT", help="Slave and master; repeat it.")
]
ObservedCell = Annotated[str | None, typer.Option("--cell", help="Which cell; default cell.")]
ObserverConfig = Annotated[
    Path | None, typer.Option("--config", metavar="FILE", help="YAML of a viewer or recorder, instead.")
]
ObserverPki = Annotated[
    Path | None, typer.Option("--pki", metavar="DIR", help="Certificates of a viewer or recorder.")
]
ThroughRouter = Annotated[bool, typer.Option("--through-router", help="What it connects to is a router.")]
Insecure = Annotated[
    bool,
    typer.Option("--insecure", help="Do without certificates outside this host; never with a real stage."),
]
AcceptPrior = Annotated[
    bool, typer.Option("--accept-prior", help="Start from another patient's prior where there is no other.")
]
Duration = Annotated[
    float | None, typer.Option("--duration", min=0.0, help="End after this many seconds.", metavar="S")
]
_COLUMN_HELP = "Column and its unit, e.g. {}; default: by the names."
TimeColumn = Annotated[
    str | None, typer.Option("--time", metavar="UNIT:COLUMN", help=_COLUMN_HELP.format("ms:elapsed"))
]
PositionColumn = Annotated[
    str | None, typer.Option("--position", metavar="UNIT:COLUMN", help=_COLUMN_HELP.format("mm:laser"))
]
ForceColumn = Annotated[
    str | None, typer.Option("--force", metavar="UNIT:COLUMN", help=_COLUMN_HELP.format("N:Load cell"))
]
RowRate = Annotated[
    float | None, typer.Option("--rate", metavar="HZ", help="Of the rows, where no column has their time.")
]
ResultsFolder = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="For the results; default: named after FILE.")
]
AsJson = Annotated[bool, typer.Option("--json", help="The answer as one JSON document.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Say errors only.")]


def number(metavar: str, low: float, high: float, text: str) -> Any:  # noqa: ANN401 - typer's
    """Makes a typer option for a number, or None; one outside `low` to `high`, or nan, is typer.BadParameter.
    `metavar` and `text` are for the help.
    """

    def check(value: float | None) -> float | None:
        if value is not None and not low <= value <= high:
            raise typer.BadParameter(f"{value:g}: expected {low:g} to {high:g}")
        return value

    return typer.Option(metavar=metavar, callback=check, help=text)


def examples(*lines: str) -> Callable[[Command], Command]:
    """Adds command lines that the help of a command shows."""

    def noted(command: Command) -> Command:
        _EXAMPLES[command] = lines
        return command

    return noted


def examples_of(command: Callable[..., None]) -> tuple[str, ...]:
    return _EXAMPLES[command]


@contextmanager
def extra(name: str, *packages: str) -> Iterator[None]:
    """Turns a ModuleNotFoundError of the body into one line that says how to install `forefeel[name]`, if the
    module is of `packages`; that of another module passes as it is.

    Raises:
        ConfigurationError: one of `packages` is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in packages:
            raise
        raise ConfigurationError(f"needs an extra: pip install 'forefeel[{name}]'") from error
