"""`forefeel home`."""

from forefeel.commands.calibrate import Axis, ConfigFile, Yes
from forefeel.commands.options import Quiet, examples
from forefeel.terminal import output, suggest


@examples("forefeel home --config slave.yaml --axis insertion")
def home(config: ConfigFile, axis: Axis = "insertion", yes: Yes = False, quiet: Quiet = False) -> None:
    from forefeel.calibrate.procedure import run_home  # noqa: PLC0415 - the help needs none of it

    with output(quiet=quiet):
        run_home(config, axis, yes)
        suggest("slave", config=config)
