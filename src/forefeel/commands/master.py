"""`forefeel master`."""

from forefeel.commands.options import AcceptPrior, DaemonConfig, Duration, Insecure, Quiet, examples
from forefeel.daemon_settings import load_daemon
from forefeel.terminal import output, suggest


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
        settings = load_daemon(config, "master")
        suggest("estop", head="to stop it, from another terminal", config=config)
        if accept_prior:
            settings = settings.model_copy(update={"accept_prior": True})
        run_daemon(settings, duration, insecure)
