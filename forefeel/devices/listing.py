"""`forefeel devices`: drivers, serial ports, CAN interfaces."""

import json
import sys
from dataclasses import asdict

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from forefeel.devices.drivers import DRIVERS
from forefeel.devices.ports import CanInterface, SerialPort, can_interfaces, serial_ports

_PLAIN_WIDTH = 160


def run_devices(as_json: bool) -> None:
    """Prints what there is, for a person or a program."""
    serial, can = serial_ports(), can_interfaces()
    if as_json:
        print(json.dumps(_document(serial, can), indent=2))
        return
    terminal = sys.stdout.isatty()
    console = Console(highlight=False, markup=False, width=None if terminal else _PLAIN_WIDTH)
    console.print(_drivers(terminal))
    console.print(_ports(serial, terminal) if serial else "No serial port.", style="")
    for port in serial:
        if port.advice:
            console.print(Text(port.advice, style="yellow"), soft_wrap=True)
    for interface in can:
        state = "up" if interface.up else interface.advice
        console.print(f"CAN interface {interface.name}: {state}", soft_wrap=True)
    if not can:
        console.print("No CAN interface of the kernel; slcan needs none, only a serial port.")


def _document(serial: list[SerialPort], can: list[CanInterface]) -> dict[str, object]:
    drivers = [{"slot": d.slot, "driver": d.name, "hardware": bool(d.place), "what": d.what} for d in DRIVERS]
    return {
        "schema": "forefeel.devices/1",
        "drivers": drivers,
        "serial_ports": [asdict(port) for port in serial],
        "can_interfaces": [asdict(interface) for interface in can],
    }


def _table(title: str, columns: tuple[str, ...], terminal: bool) -> Table:
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD if terminal else box.ASCII2)
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def _drivers(terminal: bool) -> Table:
    table = _table("Drivers", ("slot", "driver", "what it is"), terminal)
    for driver in DRIVERS:
        table.add_row(driver.slot, driver.name, driver.what)
    return table


def _ports(serial: list[SerialPort], terminal: bool) -> Table:
    table = _table("Serial ports", ("port", "stable name", "USB", "serial", "what", "latency"), terminal)
    for port in serial:
        latency = "" if port.latency_ms is None else f"{port.latency_ms} ms"
        row = (port.device, port.stable or "", port.usb or "", port.serial or "", port.description, latency)
        table.add_row(*(Text(cell) for cell in row))
    return table
