"""`forefeel devices`: drivers, and the serial ports and CAN interfaces of this host; nothing is opened."""

import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text
from serial.tools import list_ports

from forefeel.common.hardware.driver import every_driver
from forefeel.devices.shared.stream import latency_warning
from forefeel.terminal import answer, table

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
    advice: str | None

    @property
    def usb(self) -> str | None:
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
    """Lists the serial ports of this host by device file, with stable name, USB data and advice; opens none.
    `by_id`: the folder of the stable names.
    """
    links = sorted(by_id.iterdir(), reverse=True) if by_id.is_dir() else []
    names = {os.path.realpath(link): str(link) for link in links}  # the first of each device
    ports = []
    for port in sorted(list_ports.comports(), key=lambda port: str(port.device)):
        device = str(port.device)
        words = port.description if port.description not in (None, "n/a") else ""
        ports.append(
            SerialPort(
                device,
                names.get(os.path.realpath(device)),
                port.vid,
                port.pid,
                port.serial_number,
                " ".join(str(words).split()),
                latency_warning(device),
            )
        )
    return ports


def can_interfaces(net: Path = _NET) -> list[CanInterface]:
    """Lists the SocketCAN interfaces of this host, whether each is up, and how to bring it up if not.
    (python-can's own search also tries each adapter's library: seconds.) `net`: the folder of sysfs.
    """
    interfaces = []
    for folder in sorted(net.iterdir()) if net.is_dir() else ():
        if _read(folder / "type") != _CAN:
            continue
        up = bool(int(_read(folder / "flags") or "0", 16) & _IFF_UP)
        advice = f"ip link set {folder.name} up type can bitrate 1000000 restart-ms 100"
        interfaces.append(CanInterface(folder.name, up, None if up else f"down; as root: {advice}"))
    return interfaces


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""


# --- the command ---


def run_devices() -> None:
    serial, can = serial_ports(), can_interfaces()
    answer(*_in_words(serial, can), document=lambda: _document(serial, can))


def _in_words(serial: list[SerialPort], can: list[CanInterface]) -> Iterator[RenderableType]:
    """Yields what the terminal shows: a table of drivers, one of ports with advice, and CAN interfaces."""
    yield _drivers()
    yield _ports(serial) if serial else "No serial port."
    for port in serial:
        if port.advice:
            yield Text(port.advice, style="yellow")
    for interface in can:
        yield f"CAN interface {interface.name}: {'up' if interface.up else interface.advice}"
    if not can:
        yield "No CAN interface of the kernel; slcan needs none, only a serial port."


def _document(serial: list[SerialPort], can: list[CanInterface]) -> dict[str, object]:
    """Returns what `--json` prints: installed drivers, serial ports, CAN interfaces."""
    drivers = [
        {
            "slot": driver.slot,
            "driver": driver.name,
            "hardware": driver.driver.settings.hardware,
            "what": driver.driver.what,
            "distribution": driver.distribution,
            "version": driver.version,
        }
        for driver in every_driver()
    ]
    return {
        "schema": "forefeel.devices/1",
        "drivers": drivers,
        "serial_ports": [asdict(port) for port in serial],
        "can_interfaces": [asdict(interface) for interface in can],
    }


def _drivers() -> Table:
    made = table("slot", "driver", "what it is", "from", title="Drivers")
    for driver in every_driver():
        made.add_row(driver.slot, driver.name, driver.driver.what, f"{driver.distribution} {driver.version}")
    return made


def _ports(serial: list[SerialPort]) -> Table:
    made = table("port", "stable name", "USB", "serial", "what", title="Serial ports")
    for port in serial:
        row = port.device, port.stable or "", port.usb or "", port.serial or "", port.description
        made.add_row(*(Text(cell) for cell in row))
    return made
