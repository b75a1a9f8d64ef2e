"""`forefeel slave`."""

from forefeel.commands.options import DaemonConfig, DaemonInsecure, Duration, Quiet, examples
from forefeel.daemon_settings import load_daemon
from forefeel.terminal import output


@examples("forefeel slave --config deploy/config/slave.yaml")
def slave(
    config: DaemonConfig, duration: Duration = None, insecure: DaemonInsecure = False, quiet: Quiet = False
) -> None:
    from forefeel.daemons import run_slave  # noqa: PLC0415 - the help needs none of it
    from forefeel.slave.settings import SlaveSettings  # noqa: PLC0415

    settings = load_daemon(config, "slave")
    assert isinstance(settings, SlaveSettings)
    with output(quiet=quiet):
        run_slave(settings, duration, insecure)
