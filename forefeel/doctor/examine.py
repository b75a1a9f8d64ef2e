"""Everything that is looked at, in the order of the list."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

from forefeel.common.settings import DaemonSettings
from forefeel.common.state.folder import holder, state_path
from forefeel.common.topics import Role
from forefeel.common.transport.security import Party, PartyRole
from forefeel.common.transport.settings import TransportSettings
from forefeel.doctor import (
    access,
    calibrations,
    certificates,
    clocks,
    devices,
    network,
    realtime,
    software,
    storage,
)
from forefeel.doctor.findings import Finding
from forefeel.doctor.settings import judge_agreement, load_files
from forefeel.probe.configured import ConfiguredDevice, configured
from forefeel.reachability import reach

# priority of SCHED_FIFO that is tried without a file, the default of `realtime.priority`
_NO_FILE_PRIORITY = 50
_OBSERVERS: tuple[PartyRole, ...] = ("viewer", "recorder")
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class End:
    """One daemon's settings, its state folder, and the process that runs with it on this host now."""

    role: Role
    settings: DaemonSettings
    state: Path
    process: int | None


def examine(files: Sequence[Path], progress: Progress, environment: Mapping[str, str]) -> list[Finding]:
    """Every check that the files allow; without files those of the host.

    Raises:
        ConfigurationError: a file is not there, or two are of one role.
    """
    loaded, findings = load_files(files)
    findings += judge_agreement(loaded)
    ends = [_end(role, settings, environment) for role, (_, settings) in loaded.items()]
    for end in ends:
        progress(f"{end.role}: certificates and access control")
        findings += _security(end)
        progress(f"{end.role}: network")
        findings += _network(end)
    for cell in dict.fromkeys(end.settings.cell for end in ends):
        progress(f"cell {cell}: clocks")
        findings += _clocks([end for end in ends if end.settings.cell == cell])
    findings += clocks.judge_discipline(clocks.ask_discipline())
    progress(f"real time, {realtime.SECONDS:g} s")
    findings += _realtime(ends)
    for end in ends:
        progress(f"{end.role}: devices")
        findings += _devices(end)
        findings += storage.judge_folder(storage.examine_folder(end.state))
    own, packages = software.read_packages()
    return [*findings, *software.judge_software(software.python_version(), own, packages)]


def _end(role: Role, settings: DaemonSettings, environment: Mapping[str, str]) -> End:
    state = state_path(settings, role, environment)
    return End(role, settings, state, holder(state))


def _security(end: End) -> Iterator[Finding]:
    transport = end.settings.transport
    yield certificates.judge_exposure(end.settings, end.role)
    if transport.pki is None:
        return
    found = certificates.read_folder(transport.pki, end.role, end.settings.cell)
    yield from certificates.judge_certificate(found, transport.listen)
    identity = certificates.find_identity(end.settings, end.role)
    if identity is not None:
        yield from access.judge_access(access.try_access(end.role, end.settings.cell, identity), end.role)


def _network(end: End) -> Iterator[Finding]:
    transport = end.settings.transport
    yield from network.judge_endpoints(transport.listen, transport.connect)
    for endpoint in transport.listen:
        yield network.judge_listen(network.try_listen(endpoint), end.process is not None)
    identity = certificates.find_identity(end.settings, end.role)
    other = "router" if transport.mode == "client" else "slave" if end.role == "master" else "master"
    for endpoint in transport.connect:
        yield network.judge_reached(reach(endpoint, identity, other))


def _clocks(ends: Sequence[End]) -> Iterator[Finding]:
    """Asked once for a cell, wherever one of its daemons can be heard."""
    first = ends[0]
    reachable = tuple(
        dict.fromkeys(endpoint for end in ends for endpoint in _reachable(end.settings.transport))
    )
    if not reachable:
        yield from clocks.judge_clocks([])
        return
    party = _observer(first)
    transport = TransportSettings(connect=reachable, pki=first.settings.transport.pki if party else None)
    axes = [axis.name for axis in _axes(first.settings)]
    found, error = clocks.hear_states(transport, party, first.settings.cell, axes)
    yield from clocks.judge_clocks(found, error)


def _reachable(transport: TransportSettings) -> Iterator[str]:
    """Where this host's and the other daemons answer."""
    yield from transport.connect
    for endpoint in transport.listen:
        yield endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")


def _observer(end: End) -> Party | None:
    """A viewer where its key lies there, too; else the daemon's own role, which hears the other end."""
    folder, cells = end.settings.transport.pki, (end.settings.cell,)
    if folder is None:
        return None
    role = next((each for each in _OBSERVERS if (folder / f"{each}.key").exists()), end.role)
    return Party(role, cells)


def _realtime(ends: Sequence[End]) -> Iterator[Finding]:
    priority = max((end.settings.realtime.priority for end in ends), default=_NO_FILE_PRIORITY)
    try:
        yield from realtime.judge_loop(realtime.measure_loop(priority, realtime.SECONDS), priority)
    except RuntimeError as error:
        yield Finding(realtime.GROUP, "1 kHz loop", "red", f"not measured: {error}", "report this")
    yield from realtime.judge_kernel(realtime.read_kernel())


def _devices(end: End) -> Iterator[Finding]:
    found, today = configured(end.settings), date.today()
    for port in dict.fromkeys(device.serial_port for device in found if device.serial_port):
        yield from devices.judge_port(devices.examine_port(port))
    for bus in devices.can_buses(found):
        yield devices.judge_can(bus)
    yield from _probed(end, found)
    for device in found:
        calibration = calibrations.read_calibration(device, today)
        if calibration is not None:
            yield calibrations.judge_calibration(calibration, today)


def _probed(end: End, found: Sequence[ConfiguredDevice]) -> Iterator[Finding]:
    real = [device for device in found if device.settings.hardware]
    if not real:
        yield Finding(devices.GROUP, f"{end.role}'s devices", "green", "all simulated")
    elif end.process is not None:
        yield devices.judge_running(end.role, end.process)
    else:
        for probed in devices.probe_devices(real):
            yield devices.judge_probed(probed)


def _axes(settings: DaemonSettings) -> Sequence[Any]:
    return getattr(settings, "axes", ())
