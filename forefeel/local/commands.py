"""`forefeel estop`, `forefeel clear`, `forefeel audit`: acts of a person beside a daemon."""

import json
import os
from pathlib import Path
from typing import Annotated

import typer

from common.audit import is_hash
from common.errors import ConfigurationError, RunError
from common.settings import DaemonSettings
from common.state.folder import AUDIT, state_path
from common.topics import Role
from common.transport.security import PartyRole
from common.transport.settings import TransportSettings
from forefeel.daemon_settings import load_any, load_daemon
from forefeel.local.audit_text import describe, entry_text, read_entries, read_verdict, verdict_json
from forefeel.local.client import NobodyThereError, ask
from forefeel.local.protocol import Answer, Request
from forefeel.options import AsJson, Insecure, Quiet, ThroughRouter, ViewerPki
from forefeel.terminal import answer, output, say

audit_app = typer.Typer(help="The audit log of a daemon.", no_args_is_help=True)
ESTOP_EPILOG = (
    "Example: forefeel estop --config deploy/config/slave.yaml --reason 'catheter kinked'   "
    "Example: forefeel estop --cell cathlab --connect tls/10.0.0.1:7447 --pki pki"
)
CLEAR_EPILOG = "Example: forefeel clear --config deploy/config/slave.yaml"
_REASON = "asked for on the command line"

LogFile = Annotated[Path, typer.Argument(metavar="FILE", help="STATE/audit.jsonl of a daemon.")]


def estop(  # noqa: PLR0913, PLR0917 - one parameter per option
    config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Of slave or master: its socket, else the network.")
    ] = None,
    cell: Annotated[str | None, typer.Option(help="Without --config: which cell.")] = None,
    connect: Annotated[list[str] | None, typer.Option(metavar="ENDPOINT", help="Where; repeat it.")] = None,
    axis: Annotated[list[str] | None, typer.Option(help="Which axes; every one that is heard.")] = None,
    reason: Annotated[str, typer.Option(help="Stands in the audit log.")] = _REASON,
    pki: ViewerPki = None,
    through_router: ThroughRouter = False,
    insecure: Insecure = False,
) -> None:
    """Stop a cell, latched until `forefeel clear` on the slave's host. Exit 1: nothing confirmed it."""
    from forefeel.network_settings import ObserverSettings, check_alone, observer  # noqa: PLC0415

    if config is None:
        if not (cell and connect):
            raise ConfigurationError("expected --config, or --cell and --connect")
        found = observer(None, cell, connect, pki, through_router)
        return _stop_there(found.transport, "viewer", cell, tuple(axis or ()), reason, insecure)
    check_alone(cell is not None, connect, pki, through_router)
    settings = load_any(config)
    if isinstance(settings, ObserverSettings):
        if settings.role != "viewer":
            raise ConfigurationError(f"{config}: role = {settings.role!r}: a recorder may not stop a cell")
        return _stop_there(settings.transport, "viewer", settings.cell, tuple(axis or ()), reason, insecure)
    if not isinstance(settings, DaemonSettings):
        raise ConfigurationError(f"{config}: expected the file of a slave, a master or a viewer")
    if _stopped_here(settings, reason):
        return None
    axes = tuple(axis or _names(settings))
    return _stop_there(_towards(settings), _role(settings), settings.cell, axes, reason, insecure)


def clear(
    config: Annotated[Path, typer.Option(metavar="FILE", help="The slave's YAML file.")],
    axis: Annotated[str | None, typer.Option(help="This one and those that stopped with it.")] = None,
) -> None:
    """Clear a latched emergency stop or fault: on the slave's host only, while the slave runs."""
    settings = load_daemon(config)
    if _role(settings) != "slave":
        raise ConfigurationError(f"{config}: role = 'master': expected the slave's file, on its host")
    folder = state_path(settings, "slave", os.environ)
    try:
        answer = ask(folder, Request(do="clear", axis=axis))
    except NobodyThereError as error:
        raise RunError(f"not cleared: {error}; {_last_words(folder)}") from error
    _say(answer)
    if not answer.done:
        raise typer.Exit(1)


@audit_app.command("verify", epilog="Example: forefeel audit verify state/audit.jsonl")
def audit_verify(
    file: LogFile,
    head: Annotated[str | None, typer.Option(metavar="HASH", help="Of an entry that must be there.")] = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Check the hash chain: exit 0 intact, 1 not."""
    if head is not None and not is_hash(head):
        raise ConfigurationError(f"--head {head}: expected 64 hexadecimal digits, as an entry's hash has")
    verdict = read_verdict(file, head)
    good = verdict.intact and (head is None or verdict.head_at is not None)
    with output(as_json, quiet):
        answer(*describe(verdict, head), document=lambda: {"intact": good, **verdict_json(verdict)})
    if not good:
        raise typer.Exit(1)


@audit_app.command("show", epilog="Example: forefeel audit show state/audit.jsonl")
def audit_show(file: LogFile, as_json: AsJson = False) -> None:
    """Print the entries, one line each, as far as the chain is intact; exit 1 where it is not."""
    entries, flaw = read_entries(file)
    for entry in entries:
        typer.echo(json.dumps(entry.noted._asdict()) if as_json else entry_text(entry))
    if flaw is not None:
        raise RunError(f"{file}:{flaw.line}: the line {flaw.what}")


def _stopped_here(settings: DaemonSettings, reason: str) -> bool:
    """Whether the daemon of these settings runs here and has stopped the cell."""
    try:
        folder = state_path(settings, _role(settings), os.environ)
        answer = ask(folder, Request(do="estop", reason=reason[:256]))
    except RunError as error:
        say(f"{error}; over the network, then")
        return False
    if answer.done:
        _say(answer)
    return answer.done


def _stop_there(
    transport: TransportSettings,
    role: PartyRole,
    cell: str,
    axes: tuple[str, ...],
    reason: str,
    insecure: bool,
) -> None:
    from forefeel.local.stop import Caller, stop_over_network, who  # noqa: PLC0415 - others start without Zenoh

    outcome = stop_over_network(Caller(transport, role, cell, insecure), axes, who(), reason)
    for axis, state in outcome.axes.items():
        typer.echo(f"axis {axis}: {state}")
    if not outcome.done:
        where = ", ".join(transport.connect)
        heard = ", ".join(f"axis {axis} {state}" for axis, state in outcome.axes.items()) or "no slave heard"
        raise RunError(
            f"EMERGENCY STOP NOT CONFIRMED by cell {cell} at {where} in {outcome.took_s:.1f} s ({heard}): "
            "USE THE STOP OF THE MACHINE ITSELF"
        )
    typer.echo(
        f"stopped in {outcome.took_s * 1e3:.0f} ms; latched until `forefeel clear` on the slave's host"
    )


def _towards(settings: DaemonSettings) -> TransportSettings:
    from forefeel.local.stop import towards  # noqa: PLC0415

    return towards(settings)


def _last_words(folder: Path) -> str:
    """How the daemon ended, by its audit log."""
    path = folder / AUDIT
    if not path.exists():
        return "expected a slave that runs"
    entries, _ = read_entries(path)
    last = entries[-1].noted if entries else None
    if last is None or last.event != "stop":
        return "the slave was killed; a new start waits for a session, an emergency stop stays latched"
    return f"the slave ended at {last.utc}: {last.details.get('reason')}; start it again"


def _say(answer: Answer) -> None:
    for line in answer.text:
        typer.echo(f"{answer.role}: {line}")


def _role(settings: DaemonSettings) -> Role:
    role: Role = settings.model_dump(include={"role"})["role"]
    return role


def _names(settings: DaemonSettings) -> list[str]:
    return [axis["name"] for axis in settings.model_dump(include={"axes": {"__all__": {"name"}}})["axes"]]
