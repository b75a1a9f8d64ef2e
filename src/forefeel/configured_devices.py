"""The devices that a daemon's YAML file names."""

import os
from pathlib import Path
from typing import Any, NamedTuple

from forefeel.common.errors import ConfigurationError
from forefeel.common.hardware.driver import InstalledDriver, Slot, driver_of, imported
from forefeel.common.settings import DaemonSettings
from forefeel.common.state.folder import holder, state_path
from forefeel.daemon_settings import load_daemon
from forefeel.devices.shared.settings import SerialSettings


class ConfiguredDevice(NamedTuple):
    """A device that a daemon's settings name, by the section of its driver; not opened."""

    axis: str
    settings: Any
    driver: InstalledDriver

    @property
    def name(self) -> str:
        return f"{self.axis} {self.driver.slot}"

    @property
    def where(self) -> str:
        """The port, the bus or the service; empty without hardware."""
        can = getattr(self.settings, "can", None)
        if can is not None:
            return f"{can.interface} {can.channel} node {self.settings.node_id}"
        return str(getattr(self.settings, "port", getattr(self.settings, "url", "")))

    @property
    def serial_port(self) -> str | None:
        """The serial port, that of a CAN adapter too."""
        can = getattr(self.settings, "can", None)
        if can is not None:
            return str(can.channel).partition("@")[0] if can.interface == "slcan" else None
        return self.settings.port if isinstance(self.settings, SerialSettings) else None


def configured(settings: DaemonSettings) -> list[ConfiguredDevice]:
    return [
        ConfiguredDevice(axis.name, section, driver_of(slot, section))
        for axis in settings.axes
        for slot, section in axis.sections.items()
    ]


def require_released(config: Path) -> None:
    """Raises ConfigurationError where the daemon of these settings runs: it holds their devices, and a CAN
    bus does not keep another program from them.
    """
    settings = load_daemon(config)
    process = holder(state_path(settings, settings.role, os.environ))
    if process is not None:
        raise ConfigurationError(
            f"{config}: the {settings.role} runs (process {process}) and holds its devices; "
            "expected it to be ended first"
        )


def import_drivers(settings: DaemonSettings) -> None:
    for device in configured(settings):
        imported(device.driver.driver.make)


def device_of(config: Path, axis: str, slot: Slot) -> ConfiguredDevice:
    """Device in that slot of an axis, by a slave's YAML file, which is loaded; no device is opened. One
    without hardware behind it (a simulated one) does not count.

    Raises:
        ConfigurationError: the file is wrong or no slave's, no such axis, or no hardware in that slot.
    """
    devices = [device for device in configured(load_daemon(config, "slave")) if device.driver.slot == slot]
    real = {device.axis: device for device in devices if device.settings.hardware}
    if axis not in real:
        others = f"expected --axis {' or '.join(real)}" if real else "no other axis has one, either"
        raise ConfigurationError(f"{config}: axis {axis} has no {slot} with hardware; {others}")
    return real[axis]
