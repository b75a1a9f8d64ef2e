"""CAN buses as python-can knows them."""

import logging
from contextlib import ExitStack

import can

from forefeel.common.errors import DeviceError, DeviceSetupError
from forefeel.devices.canopen.slcan import SlcanBus
from forefeel.devices.shared.settings import CanSettings

for _name in ("can", "canopen"):  # what they log reaches the user as an error of ours, in one line
    logging.getLogger(_name).addHandler(logging.NullHandler())


def open_bus(settings: CanSettings) -> can.BusABC:
    """Opens the CAN bus that the settings name: slcan by our own `SlcanBus`, others by python-can, without
    setting their bitrate. DeviceSetupError: it can not be opened; the text is one line.
    """
    where = f"{settings.interface} {settings.channel}"
    try:
        if settings.interface == "slcan":
            return SlcanBus(settings.channel, settings.bitrate)
        return can.Bus(interface=settings.interface, channel=settings.channel)  # Linux sets the bitrate
    except DeviceError:
        raise
    except (can.CanError, OSError, ValueError, ImportError, TypeError) as error:
        why = " ".join(str(error).split())[:120] or type(error).__name__
        raise DeviceSetupError(
            f"{where}: can not be opened ({why}); expected a CAN bus that is up, see `forefeel devices`"
        ) from error


def open_until(leave: ExitStack, settings: CanSettings) -> can.BusABC:
    bus = open_bus(settings)
    leave.callback(bus.shutdown)
    return bus
