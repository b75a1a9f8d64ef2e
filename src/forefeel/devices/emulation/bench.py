"""Builds an emulated device from the section of a YAML file that its driver reads, so that both agree."""

import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from forefeel.common.config import checked
from forefeel.common.hardware.driver import DriverSettings, InstalledDriver
from forefeel.devices.emulation.contact import ContactSimulation, ForceReceiver, ForceSender
from forefeel.devices.emulation.sensing import EmulatedSensor
from forefeel.devices.emulation.wire import EmulatedDevice
from forefeel.slave.plant.settings import WorldSettings

TRAVEL_M = (-0.004, 0.124)  # m, travel of an emulated stage without a YAML file


@dataclass(slots=True)
class Load:
    """Force on an emulated load cell besides the stage's, in N; positive where it resists insertion."""

    force_n: float = 0.0


@dataclass(frozen=True, slots=True)
class Surroundings:
    """World around an emulated device.

    `force_link`: the socket between stage and load cell; None: the device stands alone. `load`: hangs on
    the cell besides. `now_s`: the time in s of a device that has a `step`.
    """

    world: WorldSettings
    force_link: Path | None
    seed: int
    load: Load = field(default_factory=Load)
    now_s: Callable[[], float] = time.monotonic


@dataclass(frozen=True, slots=True)
class SerialBench:
    """A device behind a serial port, and its speed."""

    device: EmulatedDevice
    port: Path
    baud: int


class Emulation(NamedTuple):
    """Emulation of a driver's device.

    `port_key`: the setting that names the port.
    `defaults`: the driver's settings without a YAML file, but for the port. `build`: called with
    (settings, surroundings, what is to be closed at the end), returns a `SerialBench`, or a device with
    `faults`, `provoke` and `step(wait_s)`, which waits for its host and lives until now, such as one on CAN.
    """

    defaults: dict[str, Any]
    build: Callable[[Any, Surroundings, ExitStack], Any]
    on_can: bool = False
    port_key: str = "port"

    def place(self, port: str) -> dict[str, Any]:
        """The settings that name the port, on CAN that of an slcan adapter."""
        return {"can": {"interface": "slcan", "channel": port}} if self.on_can else {self.port_key: port}

    def settings(self, driver: InstalledDriver, port: str) -> DriverSettings:
        """Settings of the driver without a YAML file; ConfigurationError: a port that can not be one."""
        given = {"driver": driver.name, **self.place(port), **self.defaults}
        return checked(driver.driver.settings, given, f"emulate {driver.name}")


def moved(around: Surroundings, sign: int, leave: ExitStack) -> Callable[[float, float, float, float], None]:
    """Makes the hook that an emulated stage calls at each step with (t_s, x_m, v_m_s, a_m_s2). It moves the
    simulated contact by that times `sign`, and sends its force to the load cell if there is a link.
    """
    contact = ContactSimulation(around.world)
    sender = (
        None if around.force_link is None else leave.enter_context(closing(ForceSender(around.force_link)))
    )

    def on_motion(t_s: float, x_m: float, v_m_s: float, a_m_s2: float) -> None:
        contact.moved(t_s, sign * x_m, sign * v_m_s, sign * a_m_s2)
        if sender is not None:
            sender.send(contact.force_n)

    return on_motion


def sensor_of(settings: Any, around: Surroundings, leave: ExitStack) -> EmulatedSensor:  # noqa: ANN401 - of a cell
    """Makes the sensor of an emulated load cell, at the cell's rate and full scale. It feels the force
    received from the stage, if there is a link, and the load, both times the cell's sign.
    """
    receiver: ForceReceiver | None = None
    if around.force_link is not None:
        receiver = leave.enter_context(closing(ForceReceiver(around.force_link)))

    def feel(_t_s: float) -> float:
        stage_n = 0.0 if receiver is None else receiver.newest_n()
        return float(settings.sign * (stage_n + around.load.force_n))

    return EmulatedSensor(feel, settings.rate_hz, settings.full_scale_n, seed=around.seed)
