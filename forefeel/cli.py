"""The command line."""

from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import Annotated

import typer

from forefeel.calibrate.cli import calibrate_app
from forefeel.common.config import dump_yaml
from forefeel.common.errors import ConfigurationError
from forefeel.common.recording.units import Mapping
from forefeel.common.transport.settings import PRESETS
from forefeel.daemon_settings import load_any, load_daemon
from forefeel.dashboard.command import EPILOG as DASHBOARD_EPILOG
from forefeel.dashboard.command import VIEW_EPILOG, view
from forefeel.dashboard.command import dashboard as live_view
from forefeel.devices.cli import EPILOG as DEVICES_EPILOG
from forefeel.devices.cli import device_app, devices
from forefeel.diagnose.command import EPILOG as DIAGNOSE_EPILOG
from forefeel.diagnose.command import diagnose
from forefeel.doctor.cli import EPILOG as DOCTOR_EPILOG
from forefeel.doctor.cli import doctor
from forefeel.emulate.command import EPILOG as EMULATE_EPILOG
from forefeel.emulate.command import emulate
from forefeel.evaluate.command import EPILOG as EVALUATE_EPILOG
from forefeel.evaluate.command import evaluate
from forefeel.local import estop
from forefeel.local.commands import CLEAR_EPILOG, audit_app, clear, typed
from forefeel.metrics.command import EPILOG as METRICS_EPILOG
from forefeel.metrics.command import metrics
from forefeel.options import AsJson, Duration, Quiet, among
from forefeel.pki.cli import pki_app
from forefeel.record_cli import EPILOG as RECORD_EPILOG
from forefeel.record_cli import record
from forefeel.reproduction.cli import EPILOG, reproduce
from forefeel.router_cli import EPILOG as ROUTER_EPILOG
from forefeel.router_cli import router
from forefeel.simulate.command import EPILOG as SIMULATE_EPILOG
from forefeel.simulate.command import simulate
from forefeel.terminal import answer, output, show

app = typer.Typer(
    name="forefeel",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=True,
)


def _version(wanted: bool) -> None:
    if wanted:
        show(f"forefeel {metadata.version('forefeel')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Contact force now, not after the network. Research software, not a medical device."""


config_app = typer.Typer(help="Settings.", no_args_is_help=True)
app.add_typer(config_app, name="config")
app.add_typer(device_app, name="device")
app.add_typer(calibrate_app, name="calibrate")
app.add_typer(pki_app, name="pki")
app.add_typer(audit_app, name="audit")
app.command(epilog=EPILOG)(reproduce)
app.command(epilog=DEVICES_EPILOG)(devices)
app.command(epilog=DOCTOR_EPILOG)(doctor)
app.command("estop", epilog=estop.EPILOG)(typed(estop.PARSER, estop.estop))
app.command(epilog=CLEAR_EPILOG)(clear)

ConfigFile = Annotated[Path, typer.Option("--config", help="The daemon's YAML file.", metavar="FILE")]
Insecure = Annotated[
    bool,
    typer.Option("--insecure", help="Do without certificates outside this host; never with a real stage."),
]


def _instruments() -> Iterable[str]:
    from forefeel.slave.plant.presets import PRESETS as WORLDS  # noqa: PLC0415 - only when a shell asks

    return WORLDS


def _hardware() -> Iterable[str]:
    from forefeel.loopback.hardware import HARDWARE  # noqa: PLC0415 - only when a shell asks

    return HARDWARE


@app.command(epilog="Example: forefeel slave --config deploy/config/slave.yaml")
def slave(
    config: ConfigFile, duration: Duration = None, insecure: Insecure = False, quiet: Quiet = False
) -> None:
    """Run the slave daemon: stage, load cell, safety gate."""
    from forefeel.daemons import run_slave  # noqa: PLC0415 - the other commands start without Zenoh
    from forefeel.slave.settings import SlaveSettings  # noqa: PLC0415

    settings = load_daemon(config, "slave")
    assert isinstance(settings, SlaveSettings)
    with output(quiet=quiet):
        run_slave(settings, duration, insecure)


@app.command(epilog="Example: forefeel master --config deploy/config/master.yaml")
def master(
    config: ConfigFile, duration: Duration = None, insecure: Insecure = False, quiet: Quiet = False
) -> None:
    """Run the master daemon: handle, haptic loop, prediction."""
    from forefeel.daemons import run_master  # noqa: PLC0415
    from forefeel.master.settings import MasterSettings  # noqa: PLC0415

    settings = load_daemon(config, "master")
    assert isinstance(settings, MasterSettings)
    with output(quiet=quiet):
        run_master(settings, duration, insecure)


@config_app.command("check", epilog="Example: forefeel config check deploy/config/slave.yaml")
def config_check(
    file: Annotated[Path, typer.Argument(metavar="FILE")], as_json: AsJson = False, quiet: Quiet = False
) -> None:
    """Print the effective settings of a file, defaults included, or what is wrong with it."""
    settings = load_any(file)
    with output(as_json, quiet):
        answer(dump_yaml(settings).rstrip("\n"), document=lambda: settings.model_dump(mode="json"))


app.command(epilog=RECORD_EPILOG)(record)
app.command(epilog=METRICS_EPILOG)(metrics)
app.command("dashboard", epilog=DASHBOARD_EPILOG)(live_view)
app.command(epilog=VIEW_EPILOG)(view)
app.command(epilog=ROUTER_EPILOG)(router)


@app.command(
    epilog="Example: forefeel loopback --impairment paper --duration 20 --out out/run   "
    "Example: forefeel loopback --recording seal_o_ring_1bar.csv --impairment paper   "
    "Example: forefeel loopback --slave-model world.yaml --hide friction.yaml --hide-at 5 --out out/run"
)
def loopback(  # noqa: PLR0913, PLR0917 - one parameter per option
    recording: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Play this recording (CSV, Parquet, MCAP).")
    ] = None,
    impairment: Annotated[
        str,
        typer.Option(
            metavar="PRESET", help=f"One of {', '.join(PRESETS)}.", autocompletion=among(lambda: PRESETS)
        ),
    ] = "none",
    duration: Duration = None,
    seed: Annotated[
        int, typer.Option(min=0, max=2**31 - 1, help="Seed of operator, world and impairment.")
    ] = 0,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Results; default out/run-DATE.")] = None,
    overwrite: Annotated[bool, typer.Option(help="Replace the results of an earlier run in DIR.")] = False,
    preset: Annotated[
        str | None,
        typer.Option(
            help="Simulated instrument: catheter (default) or guidewire.", autocompletion=among(_instruments)
        ),
    ] = None,
    virtual_time: Annotated[
        bool, typer.Option("--virtual-time", help="One process, as fast as it can, repeatable.")
    ] = False,
    slave_model: Annotated[
        Path | None, typer.Option(metavar="FILE", help="model.yaml of the simulated world.")
    ] = None,
    master_model: Annotated[
        Path | None, typer.Option(metavar="FILE", help="model.yaml of the predictor.")
    ] = None,
    hide: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="model.yaml of effects that are added to the simulated world."),
    ] = None,
    hide_at: Annotated[
        float, typer.Option(metavar="S", help="When they are switched on, by the world's time.")
    ] = 0.0,
    hardware: Annotated[
        str,
        typer.Option(
            help="simulated, emulated-serial or emulated-can: devices as their bytes.",
            autocompletion=among(_hardware),
        ),
    ] = "simulated",
    dashboard: Annotated[
        bool, typer.Option("--dashboard/--no-dashboard", help="Serve the live view while it runs.")
    ] = False,
    opens: Annotated[bool, typer.Option("--open", help="Open the live view in the browser.")] = False,
    time_column: Annotated[str | None, typer.Option("--time", metavar="UNIT:COLUMN")] = None,
    position_column: Annotated[str | None, typer.Option("--position", metavar="UNIT:COLUMN")] = None,
    force_column: Annotated[str | None, typer.Option("--force", metavar="UNIT:COLUMN")] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Run master and slave on this machine, record, and report."""
    from forefeel.loopback.command import How, run_loopback  # noqa: PLC0415 - the daemons start without the report's libraries
    from forefeel.loopback.plan import Wish  # noqa: PLC0415

    wish = Wish(
        seed=seed,
        impairment=impairment,
        preset=preset,
        duration_s=duration,
        recording=recording,
        columns=_columns(recording, time_column, position_column, force_column),
        slave_model=slave_model,
        master_model=master_model,
        hide=hide,
        hide_at_s=hide_at,
        hardware=hardware,
    )
    with output(as_json, quiet):
        run_loopback(wish, out, How(overwrite, virtual_time, dashboard or opens, opens))


app.command(epilog=EVALUATE_EPILOG)(evaluate)
app.command(epilog=DIAGNOSE_EPILOG)(diagnose)
app.command(epilog=SIMULATE_EPILOG)(simulate)
app.command(epilog=EMULATE_EPILOG)(emulate)


@app.command(epilog="Example: forefeel report run.mcap --out out/report")
def report(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A recorded run (MCAP).")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="For report.html and report.json.")],
    overwrite: Annotated[bool, typer.Option(help="Replace an earlier report in DIR.")] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Make the report of a run that was recorded before."""
    from forefeel.report.command import run_report  # noqa: PLC0415 - other commands start without it

    with output(as_json, quiet):
        run_report(file, out, overwrite)


def _columns(
    recording: Path | None, time_column: str | None, position: str | None, force: str | None
) -> Mapping | None:
    """A column mapping when the user named any column."""
    named = {"--time": time_column, "--position": position, "--force": force}
    first = next((f"{option} {column}" for option, column in named.items() if column is not None), None)
    if first is None:
        return None
    if recording is None:
        raise ConfigurationError(f"{first}: expected only with --recording, whose column it names")
    return Mapping(time_column or "s:time_s", position or "m:position_m", force)
