"""`forefeel master`."""

from typing import TYPE_CHECKING, cast

from forefeel.commands.options import AcceptPrior, DaemonConfig, Duration, Insecure, Quiet, examples
from forefeel.daemon_settings import load_daemon
from forefeel.terminal import output, suggest

if TYPE_CHECKING:
    from forefeel.master.settings import MasterSettings


@examples("forefeel master --config deploy/config/master.yaml")
def master(
    config: DaemonConfig,
    duration: Duration = None,
    accept_prior: AcceptPrior = False,
    insecure: Insecure = False,
    quiet: Quiet = False,
) -> None:
    from forefeel.daemons import run_daemon  # noqa: PLC0415 - the help needs none of it

    with output(quiet=quiet):
        settings = cast("MasterSettings", load_daemon(config, "master"))
        suggest("estop", head="to stop it, from another terminal", config=config)
        run_daemon(settings.accepting_prior() if accept_prior else settings, duration, insecure)
