"""Do the devices answer, may they be opened, and is nothing in the way? Nothing is moved."""

import grp
import json
import os
import stat
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from forefeel.common.clock import MonotonicClock
from forefeel.devices.shared.stream import latency_warning
from forefeel.doctor.findings import Finding
from forefeel.probe.configured import ConfiguredDevice
from forefeel.probe.ports import CanInterface, can_interfaces
from forefeel.probe.probe import Probed, probe

GROUP = "devices"
PROBE_S = 0.3  # s for which a device is listened to; chosen, not measured: tens of readings at 100 Hz


@dataclass(frozen=True, slots=True)
class Port:
    """A serial port. `group`: whose members may open it; `warning`: of a slow latency timer."""

    path: str
    exists: bool
    permitted: bool
    group: str = ""
    warning: str = ""


@dataclass(frozen=True, slots=True)
class CanBus:
    """A CAN interface of the kernel that is configured. `up` None: there is none of that name; `bitrate`
    None: unknown, or a virtual one.
    """

    name: str
    up: bool | None
    advice: str
    bitrate: int | None
    wanted: int


def examine_port(path: str) -> Port:
    """As the file system and the kernel show it; it is not opened."""
    try:
        found = Path(path).stat()
    except OSError:
        return Port(path, False, False)
    try:
        group = grp.getgrgid(found.st_gid).gr_name
    except KeyError:
        group = str(found.st_gid)
    permitted = stat.S_ISCHR(found.st_mode) and os.access(path, os.R_OK | os.W_OK)
    return Port(path, True, permitted, group, latency_warning(path) or "")


def judge_port(port: Port) -> list[Finding]:
    """Red: absent or not permitted; amber: a slow latency timer."""
    if not port.exists:
        return [
            Finding(
                GROUP, port.path, "red", "no such port", "plug it in; forefeel devices lists what there is"
            )
        ]
    if not port.permitted:
        advice = f"usermod -aG {port.group} USER, then log in again; deploy/udev makes it so for USB"
        return [Finding(GROUP, port.path, "red", "this user may not open it", advice)]
    if port.warning:
        return [Finding(GROUP, port.path, "amber", port.warning, "install deploy/udev/99-forefeel.rules")]
    return [Finding(GROUP, port.path, "green", "may be opened")]


def can_buses(devices: Sequence[ConfiguredDevice]) -> list[CanBus]:
    """The SocketCAN interfaces that the devices need."""
    wanted = {
        str(can.channel): int(can.bitrate)
        for can in (getattr(device.settings, "can", None) for device in devices)
        if can is not None and can.interface == "socketcan"
    }
    known = {each.name: each for each in can_interfaces()} if wanted else {}
    return [_can_bus(name, known.get(name), bitrate) for name, bitrate in wanted.items()]


def _can_bus(name: str, found: CanInterface | None, wanted: int) -> CanBus:
    if found is None:
        return CanBus(name, None, "", None, wanted)
    return CanBus(name, found.up, found.advice or "", _bitrate(name), wanted)


def _bitrate(name: str) -> int | None:
    command = ["ip", "-json", "-details", "link", "show", "dev", name]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=2, check=False)
        return int(json.loads(done.stdout)[0]["linkinfo"]["info_data"]["bittiming"]["bitrate"])
    except (OSError, subprocess.TimeoutExpired, ValueError, LookupError, TypeError):
        return None


def judge_can(bus: CanBus) -> Finding:
    """Red: absent, down, or at another bitrate; amber: the bitrate is unknown."""
    if bus.up is None:
        return Finding(
            GROUP, bus.name, "red", "no such CAN interface", "plug it in; ip link shows what there is"
        )
    if not bus.up:
        return Finding(GROUP, bus.name, "red", "down", bus.advice)
    if bus.bitrate is None:
        found = f"up, bitrate unknown, expected {bus.wanted}"
        return Finding(GROUP, bus.name, "amber", found, f"ip -details link show {bus.name}")
    if bus.bitrate != bus.wanted:
        advice = f"as root: ip link set {bus.name} down, then up type can bitrate {bus.wanted} restart-ms 100"
        return Finding(GROUP, bus.name, "red", f"bitrate {bus.bitrate}, expected {bus.wanted}", advice)
    return Finding(GROUP, bus.name, "green", f"up, bitrate {bus.bitrate}")


def probe_devices(devices: Sequence[ConfiguredDevice]) -> list[Probed]:
    """Talks to each of them for a moment."""
    return [probe(device, PROBE_S, MonotonicClock()) for device in devices]


def judge_probed(found: Probed) -> Finding:
    """Red: it does not answer or is another one; amber: another program holds it, or not all was valid."""
    subject = f"{found.axis} {found.slot}, {found.driver}"
    match found.verdict:
        case "simulated":
            return Finding(GROUP, subject, "green", "simulated")
        case "ready" if not found.invalid:
            trip = "" if found.round_trip is None else f", round trip p99 {found.round_trip.p99_ms:.2g} ms"
            rate = "" if found.rate_hz is None else f", {found.rate_hz:.4g} Hz"
            return Finding(GROUP, subject, "green", f"answers: {found.identity or found.where}{rate}{trip}")
        case "ready":
            advice = f"forefeel device probe --config FILE shows what is counted at {found.where}"
            return Finding(GROUP, subject, "amber", f"answers; {found.invalid} readings not valid", advice)
    error = found.error or "failed"
    if "busy" in error:
        return Finding(GROUP, subject, "amber", f"not asked: {error}", "end what holds it, then ask again")
    return Finding(
        GROUP, subject, "red", error, "power, cable, port and baud; forefeel device probe tells more"
    )


def judge_running(role: str, process: int) -> Finding:
    """Devices are left to the daemon that uses them."""
    found = f"not asked: the {role} runs (process {process}) and holds its devices"
    return Finding(GROUP, f"{role}'s devices", "amber", found, f"end the {role}, then ask again")
