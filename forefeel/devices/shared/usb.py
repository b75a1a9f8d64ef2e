"""Which device is behind a serial port, as far as the port itself knows."""

import os

from serial.tools import list_ports


def port_serial(port: str) -> str:
    """The serial number of the USB adapter or device behind a port; empty where it has none."""
    device = os.path.realpath(port)
    for each in list_ports.comports():
        if each.device == device and each.serial_number:
            return str(each.serial_number)
    return ""
