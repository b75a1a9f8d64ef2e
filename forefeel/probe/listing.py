"""`forefeel devices`: drivers, serial ports, CAN interfaces."""

from collections.abc import Iterator
from dataclasses import asdict

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from forefeel.common.hardware.driver import every_driver
from forefeel.probe.ports import CanInterface, SerialPort, can_interfaces, serial_ports
from forefeel.terminal import answer, table


def run_devices() -> None:
    """Answers what there is, for a person or a program."""
    serial, can = serial_ports(), can_interfaces()
    answer(*_in_words(serial, can), document=lambda: _document(serial, can))


def _in_words(serial: list[SerialPort], can: list[CanInterface]) -> Iterator[RenderableType]:
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
    drivers = [
        {
            "slot": each.slot,
            "driver": each.name,
            "hardware": each.driver.settings.hardware,
            "what": each.driver.what,
            "distribution": each.distribution,
            "version": each.version,
        }
        for each in every_driver()
    ]
    return {
        "schema": "forefeel.devices/1",
        "drivers": drivers,
        "serial_ports": [asdict(port) for port in serial],
        "can_interfaces": [asdict(interface) for interface in can],
    }


def _drivers() -> Table:
    made = table("slot", "driver", "what it is", "from", title="Drivers")
    for each in every_driver():
        made.add_row(each.slot, each.name, each.driver.what, f"{each.distribution} {each.version}")
    return made


def _ports(serial: list[SerialPort]) -> Table:
    made = table("port", "stable name", "USB", "serial", "what", "latency", title="Serial ports")
    for port in serial:
        latency = "" if port.latency_ms is None else f"{port.latency_ms} ms"
        row = (port.device, port.stable or "", port.usb or "", port.serial or "", port.description, latency)
        made.add_row(*(Text(cell) for cell in row))
    return made
