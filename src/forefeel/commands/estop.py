"""`forefeel estop` as typer sees it: for completion and the reference. It is run before typer is imported."""

from collections.abc import Callable
from inspect import Parameter, Signature
from optparse import OptionParser
from typing import Annotated

import typer

from forefeel.commands.options import examples
from forefeel.estop import command as stops


def _typer_command(parser: OptionParser, act: Callable[..., None]) -> Callable[..., None]:
    """Makes a function for typer with each option of `parser` as a keyword, which calls `act` with all."""

    def command(**options: object) -> None:
        act(**options)

    kinds = {"store": str | None, "append": list[str] | None, "store_true": bool}
    parameters = [
        Parameter(
            option.dest,
            Parameter.KEYWORD_ONLY,
            default=parser.defaults[option.dest],
            annotation=Annotated[
                kinds[option.action],
                typer.Option(option.get_opt_string(), metavar=option.metavar, help=option.help),
            ],
        )
        for option in parser.option_list
        if option.dest
    ]
    setattr(command, "__signature__", Signature(parameters))  # noqa: B010 - of no type that has it
    return command


estop = examples(*stops.EXAMPLES)(_typer_command(stops.PARSER, stops.estop))
