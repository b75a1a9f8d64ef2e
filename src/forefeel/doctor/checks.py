"""Every check, in the order of the list."""

import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from forefeel.common.errors import ConfigurationError, EndpointError
from forefeel.common.lateness import FEW_MISSED
from forefeel.common.limiter import LEAST_M_S, claim, open_speed_m_s
from forefeel.common.settings import DaemonSettings
from forefeel.common.state.folder import state_path
from forefeel.common.topics import Role
from forefeel.common.transport.exposure import check_exposure
from forefeel.common.transport.pki import read_certificate, read_identity, renewal
from forefeel.common.transport.security import Party, PartyRole
from forefeel.common.transport.settings import TransportSettings
from forefeel.configured_devices import ConfiguredDevice, configured
from forefeel.daemon_settings import load_daemon
from forefeel.doctor.host import CellStates, ClockState, HostProbe, LoopCheck
from forefeel.probe.probe import Probed
from forefeel.reachability import Reached
from forefeel.slave.settings import SlaveSettings

Level = Literal["green", "amber", "red"]
LEVELS: tuple[Level, ...] = ("green", "amber", "red")
LOOP_S = 2.0
_NO_FILE_PRIORITY = 50  # default of `realtime.priority`
_SOON_DAYS = 30
_GOOD_US, _POOR_US = 250.0, 1000.0  # lateness at the 99th percentile: a quarter of a period, and a whole one
_MANY_MISSED = 0.01  # share of ticks
_GOOD_NS, _ACCEPTABLE_NS = 1_000_000, 10_000_000  # uncertainty of the clocks' offset
_PLENTY_BYTES, _LEAST_BYTES = 2e9, 200e6  # a recording takes about 1 GB an hour
_EVERYWHERE = {"0.0.0.0", "[::]", "::"}
_THIS_HOST = {"127.0.0.1", "[::1]", "::1", "localhost"}
_PERMISSION = (
    "permit it: systemd units have LimitRTPRIO and LimitMEMLOCK; else rtprio 90 and memlock unlimited for "
    "this user in /etc/security/limits.d, then log in again"
)


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the list.

    Attributes:
        group: the group of checks.
        subject: what was looked at.
        level: green is fit, amber works with less than it should, red does not work or must not.
        found: what was found.
        advice: what to do; empty where there is nothing to do.
    """

    group: str
    subject: str
    level: Level
    found: str
    advice: str = ""


def examine(
    files: Sequence[Path], host: HostProbe, progress: Callable[[str], None], environment: Mapping[str, str]
) -> list[Finding]:
    """Runs every check that the settings files allow, then those of the host alone; returns the findings.
    Calls `progress` with what is being checked. Without files only versions and real time are checked.

    Raises:
        ConfigurationError: a file can not be loaded, or two are of one role.
    """
    ends = _load(files)
    findings: list[Finding] = []
    for settings in ends:
        progress(f"{settings.role}: certificates, network, clocks")
        findings += check_certificates(settings, host)
        findings += check_network(settings, host)
        progress(f"{settings.role}: devices, disk")
        state = state_path(settings, settings.role, environment)
        findings += check_devices(settings, host.running(state), host)
        findings += check_latch(settings, host.latched(state))
        findings += check_caveats(settings)
        findings += check_force_limit(settings)
        findings += check_disk(state, host)
    versions = f"{metadata.version('forefeel')}, Python {platform.python_version()}"
    findings.append(Finding("versions", "forefeel", "green", versions))
    progress(f"real time, {LOOP_S:g} s")
    priority = max((settings.realtime.priority for settings in ends), default=_NO_FILE_PRIORITY)
    return [*findings, *check_loop(host.loop(priority, LOOP_S), priority)]


def _load(files: Sequence[Path]) -> list[DaemonSettings]:
    """Loads the daemons' settings files. ConfigurationError: one is wrong, or two are of one role."""
    loaded: list[DaemonSettings] = []
    for path in files:
        settings = load_daemon(path)
        if any(other.role == settings.role for other in loaded):
            raise ConfigurationError(f"--config {path}: another {settings.role}; expected one of each role")
        loaded.append(settings)
    return loaded


def check_certificates(settings: DaemonSettings, host: HostProbe) -> Iterator[Finding]:
    """Yields findings on the exposure of the endpoints, a key of the authority here, the certificate and its
    names. Red: not secured towards a network, a certificate that can not be used, a name missing in it;
    amber: it expires soon, or the authority's key is on this host. Without certificates only the first.
    """
    role, transport, group = settings.role, settings.transport, "certificates"
    try:
        secured = transport.pki is not None
        ways = transport.listen, transport.connect
        notice = check_exposure(*ways, secured=secured, insecure=True, real_stage=settings.real_stage)
    except EndpointError as error:
        notice, secured = str(error), False
    if notice:
        advice = "forefeel pki init makes certificates; name this host's folder in transport.pki"
        yield Finding(group, f"{role}'s traffic", "red", notice, advice)
    else:
        text = "certificates on every endpoint" if secured else "stays on this host, needs no certificates"
        yield Finding(group, f"{role}'s traffic", "green", text)
    folder, party = transport.pki, Party(role, (settings.cell,))
    if folder is None:
        return
    if (folder / "ca.key").exists():
        advice = "keep it off the hosts: whoever has it makes any certificate"
        yield Finding(group, "authority", "amber", f"{folder}/ca.key lies on this host", advice)
    try:
        left_days = (read_identity(folder, party, host.now()).expires - host.now()).days
    except ConfigurationError as error:
        text, _, advice = str(error).partition("; ")
        yield Finding(group, party.name, "red", text, advice)
        return
    soon = left_days < _SOON_DAYS
    advice = f"expected {renewal(folder / f'{role}.crt')}" if soon else ""
    text = f"valid, {left_days} days left"
    yield Finding(group, party.name, "amber" if soon else "green", text, advice)
    yield from _check_names(folder, role, party, transport.listen)


def _check_names(folder: Path, role: Role, party: Party, listen: Sequence[str]) -> Iterator[Finding]:
    """Yields a finding on the names in the certificate: red unless it names all addresses that are listened
    at, for a wildcard any other host. Nothing when the daemon listens on this host alone.
    """
    from forefeel.pki.authority import hosts_of  # noqa: PLC0415 - loads the library of certificates

    wanted = [endpoint.partition("/")[2].rpartition(":")[0] for endpoint in listen]
    outside = [name for name in wanted if name not in _THIS_HOST]
    if not outside:
        return
    hosts = hosts_of(read_certificate(folder / f"{role}.crt"))
    missing = [name for name in outside if name not in _EVERYWHERE and name.strip("[]") not in hosts]
    named = ", ".join(hosts) or "none but this host's own"
    advice = f"forefeel pki init DIR --hosts {party.cells[0]}/{role}=ADDRESS, with all that others use"
    if missing or not hosts:
        lacks = f"; not {', '.join(missing)}" if missing else ": no other host accepts it"
        yield Finding("certificates", f"{party.name}, names", "red", f"{named}{lacks}", advice)
    else:
        yield Finding("certificates", f"{party.name}, names", "green", named)


def check_network(settings: DaemonSettings, host: HostProbe) -> Iterator[Finding]:
    """Yields a finding on each endpoint of `transport.connect`, tried with our certificate, then on the
    clocks. Red without any endpoint; nothing where the certificate can not be read.
    """
    role, transport = settings.role, settings.transport
    if not transport.listen and not transport.connect:
        advice = "name one in transport.listen or transport.connect"
        yield Finding("network", "endpoints", "red", "none", advice)
        return
    party, identity = Party(role, (settings.cell,)), None
    if transport.pki is not None:
        try:
            identity = read_identity(transport.pki, party, host.now()).identity
        except ConfigurationError:
            return  # reported with the certificates
    other = "router" if transport.mode == "client" else "slave" if role == "master" else "master"
    for endpoint in transport.connect:
        yield _judged_reach(host.reach(endpoint, identity, other))
    observer: PartyRole = role
    if transport.pki is not None and (transport.pki / "viewer.key").exists():
        observer = "viewer"  # it hears both ends, a daemon's own role only the other one
    local = [end.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:") for end in transport.listen]
    way = TransportSettings(mode=transport.mode, connect=(*transport.connect, *local), pki=transport.pki)
    secured = Party(observer, (settings.cell,)) if transport.pki is not None else None
    axes = [axis.name for axis in settings.axes]
    yield from check_clocks(host.states(way, secured, settings.cell, axes))


def _judged_reach(reached: Reached) -> Finding:
    """Returns the finding on an endpoint: red for an obstacle, amber if it can not be tried, else green."""
    if reached.obstacle is not None:
        return Finding("network", reached.endpoint, "red", reached.obstacle.what, reached.obstacle.advice)
    if reached.connect_s is None:
        what = "can not be tried from here: only tcp/ and tls/ are"
        return Finding(
            "network", reached.endpoint, "amber", what, "start the daemon: it says what it waits for"
        )
    tls = "" if reached.handshake_s is None else f", TLS handshake {reached.handshake_s * 1e3:.1f} ms"
    trip = f"answers, round trip {reached.connect_s * 1e3:.2f} ms{tls}"
    return Finding("network", reached.endpoint, "green", trip)


def check_clocks(received: CellStates) -> Iterator[Finding]:
    """Yields a finding on each end's clock offset, by its bound: green to 10 ms, amber above; amber when no
    end is heard or there is no session, red when unknown in one. Before them a red one of the network where
    `received.hint` says that `transport.mode` is wrong.
    """
    if received.hint:
        yield Finding("network", "mode", "red", received.hint, "correct transport.mode")
    if not received.states:
        text = f"unknown: {received.error or 'no daemon of this cell is heard'}"
        yield Finding("clock", "between the ends", "amber", text, "start slave and master, then ask again")
    for state in received.states:
        yield _judged_clock(state)


def _judged_clock(state: ClockState) -> Finding:
    """Returns the finding on an offset, by its bound: green to 10 ms (good below 1 ms), amber above. Unknown:
    red in an open session, amber without one.
    """
    subject = f"{state.end}, axis {state.axis}"
    if state.offset_ns is None or state.bound_ns is None:
        if state.session:
            advice = "both ends of one release, and no program between them that drops heartbeats"
            return Finding("clock", subject, "red", "unknown in an open session: nothing arms", advice)
        return Finding("clock", subject, "amber", "unknown: no session", "start both ends, then ask again")
    words = f"offset {state.offset_ns * 1e-6:.3f} ms, known to {state.bound_ns * 1e-6:.3f} ms"
    if state.bound_ns <= _ACCEPTABLE_NS:
        good = "good" if state.bound_ns < _GOOD_NS else "acceptable"
        return Finding("clock", subject, "green", f"{words}: {good}")
    advice = "half the round trip; take the ages of forces as that uncertain, or use a shorter way"
    return Finding("clock", subject, "amber", f"{words}: poor", advice)


def check_devices(settings: DaemonSettings, process: int | None, host: HostProbe) -> Iterator[Finding]:
    """Probes each hardware device and yields a finding on it; nothing is moved. One finding for all: green if
    all are simulated, amber and no probe while the daemon (`process`) runs.
    """
    role = settings.role
    real = [device for device in configured(settings) if device.settings.hardware]
    if not real:
        yield Finding("devices", f"{role}'s devices", "green", "all simulated")
    elif process is not None:
        text = f"not asked: the {role} runs (process {process}) and holds its devices"
        yield Finding("devices", f"{role}'s devices", "amber", text, f"end the {role}, then ask again")
    else:
        yield from (_judged_device(device, host.probe(device)) for device in real)


def check_latch(settings: DaemonSettings, latched: Mapping[str, str]) -> Iterator[Finding]:
    """Yields a red finding for each axis with a latched stop or fault; for any other axis of a slave with a
    hardware load cell a green one, that its sign can not be checked without a motion.
    """
    for name, reason in latched.items():
        advice = "mend that; then, while the slave runs, forefeel clear --config FILE"
        yield Finding(
            "devices", f"axis {name}" if name else "every axis", "red", f"latched: {reason}", advice
        )
    for axis in settings.axes if isinstance(settings, SlaveSettings) else ():
        if axis.load_cell.hardware and not {axis.name, ""} & set(latched):
            text = "not told without a motion: the first contact or three strokes make a wrong one a fault"
            yield Finding("devices", f"{axis.name} load_cell, sign", "green", text)


def check_caveats(settings: DaemonSettings) -> Iterator[Finding]:
    """Yields an amber finding for each simulated, uncalibrated or relaxed thing of an axis with hardware."""
    for axis in settings.axes:
        for caveat in axis.caveats if any(device.hardware for device in axis.sections.values()) else ():
            advice = "name a device, calibrate it, drop it from unsafe; or mean it so"
            yield Finding("devices", f"{axis.name} settings", "amber", caveat, advice)


def _judged_device(device: ConfiguredDevice, probed: Probed) -> Finding:
    """Returns the finding on a probe: green when the device answers, amber with invalid readings or a
    warning. Amber too for a busy port; any other failure is red.
    """
    subject, error = f"{device.name}, {device.driver.name}", probed.error or "failed"
    if probed.verdict == "ready" and probed.invalid:
        advice = f"forefeel device probe --config FILE shows what is counted at {probed.where}"
        return Finding("devices", subject, "amber", f"answers; {probed.invalid} readings not valid", advice)
    if probed.verdict == "ready" and probed.warning:
        return Finding("devices", subject, "amber", probed.warning, "install deploy/udev/99-forefeel.rules")
    if probed.verdict == "ready":
        trip = "" if probed.round_trip is None else f", round trip p99 {probed.round_trip.p99_ms:.2g} ms"
        rate = "" if probed.rate_hz is None else f", {probed.rate_hz:.4g} Hz"
        return Finding("devices", subject, "green", f"answers: {probed.identity or probed.where}{rate}{trip}")
    if "busy" in error:
        advice = "end what holds it, then ask again"
        return Finding("devices", subject, "amber", f"not asked: {error}", advice)
    advice = "power, cable, port and baud; forefeel device probe tells more"
    return Finding("devices", subject, "red", error, advice)


def check_force_limit(settings: DaemonSettings) -> Iterator[Finding]:
    """Yields a finding for each axis of a slave: for which speed, wall, cell and stage its force limit holds;
    red where it leaves too little speed.
    """
    for axis in settings.axes if isinstance(settings, SlaveSettings) else ():
        reaction = axis.reaction()
        level: Level = "red" if open_speed_m_s(axis.limits, reaction) < LEAST_M_S else "green"
        advice = "" if level == "green" else "a faster stage or cell, or a softer limits.stiffest_wall_n_m"
        yield Finding("force limit", f"axis {axis.name}", level, claim(axis.limits, reaction), advice)


def check_disk(folder: Path, host: HostProbe) -> Iterator[Finding]:
    """Yields a finding on the state folder, and one on the free space where it is or will be. Folder: red if
    this user can not write it or others can, amber if others may read it. Space: green from 2 GB, amber from
    200 MB, else red.
    """
    disk = host.disk(folder)
    if not disk.writable:
        advice = "give it to the user that runs the daemon (systemd: StateDirectory)"
        yield Finding("disk", "state folder", "red", f"{folder}: can not be written by this user", advice)
    elif disk.mode is not None and disk.mode & 0o077:
        level: Level = "red" if disk.mode & 0o022 else "amber"
        what = "write" if disk.mode & 0o022 else "read"
        text = f"{folder}: mode {disk.mode:04o}, others may {what} it"
        yield Finding("disk", "state folder", level, text, f"chmod 700 {folder}")
    else:
        yield Finding("disk", "state folder", "green", str(folder))
    free = disk.free_bytes
    level = "green" if free >= _PLENTY_BYTES else "amber" if free >= _LEAST_BYTES else "red"
    advice = "" if level == "green" else "make room: an hour of recording takes about 1 GB"
    yield Finding("disk", "free space", level, f"{free / 1e9:.1f} GB at {folder}", advice)


def check_loop(loop: LoopCheck, priority: int) -> Iterator[Finding]:
    """Yields three findings on the 1 kHz loop that was run: scheduling, amber if it was not SCHED_FIFO though
    `priority` asks for it; memory, amber if it was not locked; lateness with missed ticks, green, amber or
    red, which a loop that never ticked is, too.
    """
    granted = {"scheduling": not priority or loop.scheduling.startswith("SCHED_FIFO")}
    granted["memory"] = loop.memory == "memory locked"
    for subject, text in (("scheduling", loop.scheduling), ("memory", loop.memory)):
        level: Level = "green" if granted[subject] else "amber"
        yield Finding("real time", subject, level, text, "" if granted[subject] else _PERMISSION)
    share = loop.missed / max(1, loop.ticks + loop.missed)
    level = "amber" if loop.p99_us > _GOOD_US or share > FEW_MISSED else "green"
    if loop.p99_us > _POOR_US or share > _MANY_MISSED or not loop.ticks:
        level = "red"
    what = (
        f"p50 {loop.p50_us:.0f} us, p99 {loop.p99_us:.0f} us, worst {loop.max_us:.0f} us late; "
        f"{loop.missed} of {loop.ticks + loop.missed} missed"
    )
    advice = "end other work on this host, permit real time, set the cpufreq governor to performance"
    yield Finding("real time", "1 kHz loop", level, what, "" if level == "green" else advice)
