"""One emulated device from its options to its end."""

import json
import os
import select
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from forefeel.child_process import die_with_parent
from forefeel.common.errors import ConfigurationError
from forefeel.common.hardware.driver import (
    SLOTS,
    InstalledDriver,
    every_driver,
    imported,
    installed_driver,
)
from forefeel.common.runtime.real import HOST
from forefeel.daemon_settings import load_daemon
from forefeel.devices.canopen.hub import CanHub
from forefeel.devices.emulation.bench import Emulation, Load, SerialBench, Surroundings
from forefeel.devices.emulation.pty import Pty, PtyServer
from forefeel.devices.shared.settings import CanSettings
from forefeel.interrupt import Stop, heeded
from forefeel.master.settings import MasterSettings
from forefeel.probe.configured import configured
from forefeel.slave.plant.settings import WorldSettings, preset
from forefeel.slave.settings import SlaveSettings
from forefeel.terminal import complain

_PRIORITY = 60  # of SCHED_FIFO, above the daemons' loops: the device stands for hardware of its own
_LONGEST_LINE = 200  # characters of an order
_SHOWN_CHARACTERS = 40  # characters of an unknown order that the complaint repeats
_CHUNK_BYTES = 4096  # bytes of one read
_MOST_N = 1e6  # N, largest load
CAN_HUB = "can_hub"


def emulated_names() -> list[str]:
    """What `forefeel emulate` takes: every installed driver with an emulator, and the hub of CAN adapters."""
    return [*sorted({found.name for found in every_driver() if found.driver.emulator}), CAN_HUB]


def emulated_driver(name: str) -> InstalledDriver | None:
    """The installed driver of that name that has an emulator."""
    for slot in SLOTS:
        with suppress(KeyError):
            found = installed_driver(slot, name)
            if found.driver.emulator:
                return found
    return None


@dataclass(frozen=True, slots=True)
class EmulatorOptions:
    """What the user asked for on the command line."""

    device: str
    port: str | None
    config: Path | None
    axis: str | None
    feel: Path | None
    seed: int


def run_emulator(options: EmulatorOptions, duration_s: float | None = None) -> None:
    """Runs until SIGINT, SIGTERM, SIGHUP or the end of the duration; then prints counts as JSON.

    Raises:
        InputError: an unknown device, a file or a place for the port that can not be used.
    """
    driver = emulated_driver(options.device)
    if driver is None and options.device != CAN_HUB:
        raise ConfigurationError(f"{options.device!r}: expected one of {', '.join(emulated_names())}")
    die_with_parent()
    HOST.prepare_thread(_PRIORITY)  # a microcontroller waits for no other program of this machine
    with heeded() as stop, ExitStack() as leave:
        running = _hub(options, leave) if driver is None else _emulated(driver, options, leave)
        orders = OrdersFromStdin(OrderReader(running.living.faults, running.living.provoke, running.load))
        HOST.prepare_process()  # nor for its own collector of garbage
        _run(running.living, orders, duration_s, stop)
        with suppress(OSError):  # of a terminal that is gone
            print(json.dumps({"device": options.device, **running.counts()}), flush=True)


def _run(living: "Living", orders: "OrdersFromStdin", duration_s: float | None, stop: Stop) -> None:
    end_s = None if duration_s is None else time.monotonic() + duration_s
    while not stop.wanted() and (end_s is None or time.monotonic() < end_s):
        orders.step()
        living.step()


class Living(Protocol):
    """What lives by being stepped, and can be disturbed."""

    @property
    def faults(self) -> Sequence[str]: ...

    def step(self) -> None:
        """A round of about a millisecond."""
        ...

    def provoke(self, fault: str) -> None: ...


class Running(NamedTuple):
    """An emulator that is there. `load`: what hangs on it; None: it is no load cell."""

    living: Living
    counts: Callable[[], dict[str, Any]]
    load: Load | None = None


def _emulated(driver: InstalledDriver, options: EmulatorOptions, leave: ExitStack) -> Running:
    emulation: Emulation = imported(str(driver.driver.emulator))
    settings, world = section(driver, emulation, options)
    around = Surroundings(world, options.feel, options.seed)
    load = around.load if driver.slot == "load_cell" else None
    bench = emulation.build(settings, around, leave)
    if isinstance(bench, SerialBench):
        return _serial(bench, options, load, leave)
    about: dict[str, Any]
    if emulation.on_can:
        about = {"node": settings.node_id}
        where = f"node {settings.node_id} on {settings.can.interface} {settings.can.channel}"
    else:
        about = {"where": str(getattr(settings, emulation.port_key))}
        where = f"on {about['where']}"
    print(f"{options.device} {where}", flush=True)
    return Running(bench, lambda: about, load)


def _serial(bench: SerialBench, options: EmulatorOptions, load: Load | None, leave: ExitStack) -> Running:
    port = leave.enter_context(Pty(bench.port))
    server = PtyServer(bench.device, port, bench.baud)
    print(f"{options.device} on {bench.port} at {bench.baud} baud", flush=True)

    def counts() -> dict[str, Any]:
        return {"from_host": server.to_device.bytes, "to_host": server.to_host.bytes, "lost": port.lost}

    return Running(server, counts, load)


def _hub(options: EmulatorOptions, leave: ExitStack) -> Running:
    if options.port is None:
        raise ConfigurationError("emulate can_hub: expected --port LINK,LINK")
    hub = CanHub([Path(link) for link in options.port.split(",")])
    leave.callback(hub.close)
    print(f"can_hub on {options.port}", flush=True)
    return Running(hub, hub.counts)


def section(
    driver: InstalledDriver, emulation: Emulation, options: EmulatorOptions
) -> tuple[Any, WorldSettings]:
    """The section of the file that the driver of this device reads, and the world around it.

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
    assert isinstance(daemon, SlaveSettings | MasterSettings)
    names = [axis.name for axis in daemon.axes]
    axis = next((axis for axis in daemon.axes if options.axis in (None, axis.name)), None)
    if axis is None:
        raise ConfigurationError(
            f"--axis {options.axis}: expected one of {', '.join(names)}, the axes of {options.config}"
        )
    devices = [device.settings for device in configured(daemon) if device.axis == axis.name]
    found = next((settings for settings in devices if isinstance(settings, driver.driver.settings)), None)
    if found is None:
        raise ConfigurationError(
            f"{options.config}: axis {axis.name} has no driver {options.device!r}; expected one"
        )
    changed = (
        found if options.port is None else found.model_copy(update=_elsewhere(found, emulation, options.port))
    )
    world = axis.simulation if hasattr(axis, "simulation") else preset("catheter")
    return changed, world


def _elsewhere(settings: Any, emulation: Emulation, port: str) -> dict[str, Any]:  # noqa: ANN401
    place = emulation.place(port)
    return {"can": CanSettings(**place["can"], bitrate=settings.can.bitrate)} if emulation.on_can else place


# --- what a person or a script tells it while it runs ---


class OrderReader:
    """Obeys lines: `load 1.5` where there is a load cell, and the names of the device's faults.

    Args:
        faults: the names.
        provoke: begins one of them.
        load: what `load` changes; None: no load cell.
    """

    def __init__(self, faults: Sequence[str], provoke: Callable[[str], None], load: Load | None) -> None:
        self._faults, self._provoke, self._load = tuple(faults), provoke, load

    @property
    def words(self) -> str:
        return ", ".join(([] if self._load is None else ["load N"]) + list(self._faults))

    def obey(self, line: str) -> None:
        """One line; an empty one is nothing.

        Raises:
            ConfigurationError: not one of the commands; nothing has changed.
        """
        words = line.split()
        if not words:
            return
        if len(words) == 1 and words[0] in self._faults:
            self._provoke(words[0])
        elif words[0] == "load" and len(words) == 2 and self._load is not None and len(line) <= _LONGEST_LINE:
            self._load.force_n = _force_n(words[1])
        else:
            raise ConfigurationError(f"{line.strip()[:_SHOWN_CHARACTERS]!r}: expected {self.words}")


def _force_n(word: str) -> float:
    try:
        force_n = float(word)
    except ValueError:
        force_n = float("nan")
    if not (isfinite(force_n) and abs(force_n) <= _MOST_N):
        raise ConfigurationError(f"'load {word}': expected a force in N, such as load 1.5")
    return force_n


class OrdersFromStdin:
    """Reads stdin as far as lines have come, without ever waiting. It need not be open, and may end.

    A line that is wrong is answered on stderr. In the background of a terminal nothing is read: the system
    would stop the process for it.
    """

    def __init__(self, orders: OrderReader) -> None:
        self._orders = orders
        self._end = _open_stdin()
        self._partial = b""

    def step(self) -> None:
        if self._end is None or not select.select([self._end], [], [], 0.0)[0] or _in_background(self._end):
            return
        try:
            data = os.read(self._end, _CHUNK_BYTES)
        except OSError:
            data = b""
        *lines, partial = (self._partial + data).split(b"\n")
        if not data:
            self._end, lines, partial = None, [*lines, partial], b""
        self._partial = partial[: _LONGEST_LINE + 1]
        for line in lines:
            self._obey(line.decode("utf-8", "replace"))

    def _obey(self, line: str) -> None:
        try:
            self._orders.obey(line)
        except ConfigurationError as error:
            complain(str(error))


def _open_stdin() -> int | None:
    """Its descriptor; None where there is none (a closed one may be another file by now)."""
    try:
        return None if sys.stdin is None else sys.stdin.fileno()
    except (OSError, ValueError):
        return None


def _in_background(end: int) -> bool:
    try:
        return os.isatty(end) and os.tcgetpgrp(end) != os.getpgrp()
    except OSError:
        return True
