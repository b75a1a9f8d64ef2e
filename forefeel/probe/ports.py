"""Serial ports and CAN interfaces of this host, as the kernel shows them; nothing is opened."""

import os
from dataclasses import dataclass
from pathlib import Path

from serial.tools import list_ports

from forefeel.devices.shared.stream import latency_timer_ms, latency_warning

_BY_ID = Path("/dev/serial/by-id")
_NET = Path("/sys/class/net")
_CAN = "280"  # ARPHRD_CAN
_IFF_UP = 1  # flag of an interface that is up (netdevice(7))


@dataclass(frozen=True, slots=True)
class SerialPort:
    """`stable`: the name that stays when other devices come and go; None where the device has none."""

    device: str
    stable: str | None
    vendor_id: int | None
    product_id: int | None
    serial: str | None
    description: str
    latency_ms: int | None
    advice: str | None

    @property
    def usb(self) -> str | None:
        """Vendor and product as `lsusb` writes them."""
        if self.vendor_id is None or self.product_id is None:
            return None
        return f"{self.vendor_id:04x}:{self.product_id:04x}"


@dataclass(frozen=True, slots=True)
class CanInterface:
    """A CAN interface of the kernel; `advice`: what to do before it can be used."""

    name: str
    up: bool
    advice: str | None


def serial_ports(by_id: Path = _BY_ID) -> list[SerialPort]:
    """Every serial port, by name of its device file."""
    names = _stable_names(by_id)
    found = []
    for each in sorted(list_ports.comports(), key=lambda port: str(port.device)):
        device = str(each.device)
        words = each.description if each.description not in (None, "n/a") else ""
        found.append(
            SerialPort(
                device,
                names.get(os.path.realpath(device)),
                each.vid,
                each.pid,
                each.serial_number,
                " ".join(str(words).split()),
                latency_timer_ms(device),
                latency_warning(device),
            )
        )
    return found


def can_interfaces(net: Path = _NET) -> list[CanInterface]:
    """Every SocketCAN interface. (python-can's own search also tries each adapter's library: seconds.)"""
    found = []
    for folder in sorted(net.iterdir()) if net.is_dir() else ():
        if _read(folder / "type") != _CAN:
            continue
        up = bool(int(_read(folder / "flags") or "0", 16) & _IFF_UP)
        advice = f"ip link set {folder.name} up type can bitrate 1000000 restart-ms 100"
        found.append(CanInterface(folder.name, up, None if up else f"down; as root: {advice}"))
    return found


def _stable_names(by_id: Path) -> dict[str, str]:
    """Device file -> its first name in /dev/serial/by-id."""
    links = sorted(by_id.iterdir(), reverse=True) if by_id.is_dir() else []
    return {os.path.realpath(link): str(link) for link in links}


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""
