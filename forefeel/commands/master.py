"""`forefeel master`."""

from forefeel.commands.options import DaemonConfig, DaemonInsecure, Duration, Quiet, examples
from forefeel.daemon_settings import load_daemon
from forefeel.terminal import output


@examples("forefeel master --config deploy/config/master.yaml")
def master(
    config: DaemonConfig, duration: Duration = None, insecure: DaemonInsecure = False, quiet: Quiet = False
) -> None:
    from forefeel.daemons import run_master  # noqa: PLC0415
    from forefeel.master.settings import MasterSettings  # noqa: PLC0415

    settings = load_daemon(config, "master")
    assert isinstance(settings, MasterSettings)
    with output(quiet=quiet):
        run_master(settings, duration, insecure)
