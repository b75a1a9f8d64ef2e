"""`forefeel slave`."""

from forefeel.commands.options import DaemonConfig, Duration, Insecure, Quiet, examples
from forefeel.daemon_settings import load_daemon
from forefeel.terminal import output, suggest


@examples("forefeel slave --config deploy/config/slave.yaml")
def slave(
    config: DaemonConfig, duration: Duration = None, insecure: Insecure = False, quiet: Quiet = False
) -> None:
    from forefeel.daemons import run_daemon  # noqa: PLC0415 - the help needs none of it

    with output(quiet=quiet):
        settings = load_daemon(config, "slave")
        suggest("estop", head="to stop it, from another terminal", config=config)
        run_daemon(settings, duration, insecure)
