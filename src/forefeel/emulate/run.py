"""One emulated device from its options to its end."""

import os
import re
import select
import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from forefeel.child_process import die_with_parent
from forefeel.common.errors import ConfigurationError
from forefeel.common.hardware.driver import InstalledDriver, every_driver, imported
from forefeel.common.runtime.real import HOST
from forefeel.configured_devices import configured
from forefeel.daemon_settings import load_daemon
from forefeel.devices.canopen.hub import CanHub
from forefeel.devices.emulation.bench import Emulation, Load, SerialBench, Surroundings
from forefeel.devices.emulation.pty import Pty, PtyServer
from forefeel.devices.shared.settings import CanSettings
from forefeel.interrupt import signal_flag
from forefeel.slave.plant.settings import WorldSettings, preset
from forefeel.terminal import complain, suggest

_PRIORITY = 60  # of SCHED_FIFO, above the daemons' loops: the device stands for hardware of its own
_NUMBER = re.compile(r"-?\d{1,6}(\.\d*)?")
CAN_HUB = "can_hub"


@dataclass(frozen=True, slots=True)
class EmulatorOptions:
    device: str
    port: str | None
    config: Path | None
    axis: str | None
    feel: Path | None
    seed: int


def run_emulator(options: EmulatorOptions, duration_s: float | None = None) -> None:
    """Runs one emulated device until SIGINT, SIGTERM, SIGHUP or the end of the duration; obeys stdin
    meanwhile. The process asks for real time, and ends with its parent.

    Raises:
        InputError: an unknown device, a file or a place for the port that can not be used.
    """
    drivers = {known.name: known for known in every_driver() if known.driver.emulator}
    driver = drivers.get(options.device)
    if driver is None and options.device != CAN_HUB:
        raise ConfigurationError(f"{options.device!r}: expected one of {', '.join([*drivers, CAN_HUB])}")
    die_with_parent()
    HOST.prepare_thread(_PRIORITY)  # a microcontroller waits for no other program of this machine
    with signal_flag() as stop, ExitStack() as leave:
        living, load = (_hub(options, leave), None) if driver is None else _emulated(driver, options, leave)
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)  # in the background reading fails, and stops nothing
        HOST.prepare_process()  # nor for its own collector of garbage
        for _ in stop.polls(duration_s):
            obey_stdin(living, load)
            living.step()


class Living(Protocol):
    """An emulated device that is stepped, and can be disturbed."""

    @property
    def faults(self) -> Sequence[str]: ...

    def step(self) -> None:
        """A round of about a millisecond."""
        ...

    def provoke(self, fault: str) -> None: ...


def _emulated(
    driver: InstalledDriver, options: EmulatorOptions, leave: ExitStack
) -> tuple[Living, Load | None]:
    """Builds the emulator of that driver and prints where it is; returns (emulator, load). The load can be
    changed while it runs; None but for a load cell.
    """
    emulation: Emulation = imported(str(driver.driver.emulator))
    settings, world = section(driver, emulation, options)
    around = Surroundings(world, options.feel, options.seed)
    load = around.load if driver.slot == "load_cell" else None
    bench = emulation.build(settings, around, leave)
    if isinstance(bench, SerialBench):
        where = f"on {bench.port} at {bench.baud} baud"
        bench = PtyServer(bench.device, leave.enter_context(Pty(bench.port)), bench.baud)
    elif emulation.on_can:
        where = f"node {settings.node_id} on {settings.can.interface} {settings.can.channel}"
    else:
        where = f"on {getattr(settings, emulation.port_key)}"
    print(f"{options.device} {where}", flush=True)
    if options.config is not None:
        suggest("device", "probe", head="from another terminal", config=options.config)
    return bench, load


def _hub(options: EmulatorOptions, leave: ExitStack) -> Living:
    """Builds a CAN hub on the links in `options.port` and prints where it is; it is closed with `leave`.
    ConfigurationError: no port.
    """
    if options.port is None:
        raise ConfigurationError("emulate can_hub: expected --port LINK,LINK")
    hub = CanHub([Path(link) for link in options.port.split(",")])
    leave.callback(hub.close)
    print(f"can_hub on {options.port}", flush=True)
    return hub


def section(
    driver: InstalledDriver, emulation: Emulation, options: EmulatorOptions
) -> tuple[Any, WorldSettings]:
    """Returns (settings of this device's driver, world around it), from the file, or by the port alone. With
    both, the port replaces that of the file. Without a simulation in the file, the world is `catheter`.

    Raises:
        ConfigurationError: no such axis, or another driver stands there; without a file no port.
    """
    if options.config is None:
        if options.port is None:
            raise ConfigurationError(
                f"emulate {options.device}: expected --port LINK, or --config FILE that has it"
            )
        return emulation.settings(driver, options.port), preset("catheter")
    daemon = load_daemon(options.config)
    devices = [device for device in configured(daemon) if options.axis in (None, device.axis)]
    device = next((device for device in devices if device.driver == driver), None)
    if device is None:
        axis = "" if options.axis is None else f"--axis {options.axis}: "
        names = ", ".join(axis.name for axis in daemon.axes)
        raise ConfigurationError(
            f"{axis}{options.config}: no driver {options.device!r}; expected one on an axis of {names}"
        )
    settings = device.settings
    if options.port is not None:
        place = emulation.place(options.port)
        if emulation.on_can:
            place = {"can": CanSettings(**place["can"], bitrate=settings.can.bitrate)}
        settings = settings.model_copy(update=place)
    axis_settings = next(axis for axis in daemon.axes if axis.name == device.axis)
    return settings, getattr(axis_settings, "simulation", None) or preset("catheter")


def obey(line: str, living: Living, load: Load | None) -> None:
    """Obeys one line: the name of a fault begins it, `load 1.5` sets the force in N of a load cell. An empty
    line does nothing. ConfigurationError: any other; nothing has changed.
    """
    match line.split():
        case []:
            pass
        case [fault] if fault in living.faults:
            living.provoke(fault)
        case ["load", force_n] if load is not None and _NUMBER.fullmatch(force_n):
            load.force_n = float(force_n)
        case _:
            loads = [] if load is None else ["load N"]
            raise ConfigurationError(f"{line.strip()[:40]!r}: expected {', '.join([*loads, *living.faults])}")


def obey_stdin(living: Living, load: Load | None) -> None:
    """Obeys the lines that have come on stdin, without waiting; a wrong one is answered on stderr. Nothing
    where stdin is closed or can not be read.
    """
    try:
        ready = sys.stdin is not None and select.select([sys.stdin], [], [], 0.0)[0]
        lines = os.read(sys.stdin.fileno(), 4096).decode("utf-8", "replace") if ready else ""
    except OSError:  # of a terminal that is gone, or that another process reads
        return
    for line in lines.splitlines():
        try:
            obey(line, living, load)
        except ConfigurationError as error:
            complain(str(error))
