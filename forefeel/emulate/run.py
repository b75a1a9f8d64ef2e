"""One emulated device from its options to its end."""

import json
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from pydantic import BaseModel

from forefeel.common.config import checked
from forefeel.common.errors import ConfigurationError
from forefeel.common.hardware.settings import CanSettings
from forefeel.common.runtime.realtime import prepare_process, prepare_thread
from forefeel.daemon_settings import load_daemon
from forefeel.devices.configured import configured
from forefeel.emulate import benches, can_benches
from forefeel.emulate.benches import SerialBench, Surroundings
from forefeel.emulate.can_hub import CanHub
from forefeel.emulate.canopen_device import CanopenDevice
from forefeel.emulate.orders import Load, OrderReader, OrdersFromStdin
from forefeel.emulate.pty import Pty, PtyServer
from forefeel.emulate.wire import Faults, Timetable
from forefeel.interrupt import Stop, heeded
from forefeel.master.settings import CoilSettings, MasterSettings
from forefeel.parent import die_with_parent
from forefeel.slave.load_cells.settings import AsciiLineSettings, BotaSettings, Cia404Settings
from forefeel.slave.plant.settings import WorldSettings, preset
from forefeel.slave.settings import SlaveSettings
from forefeel.slave.stages.settings import Cia402Settings, ZaberSettings

_PRIORITY = 60  # above the loops of the daemons: hardware of its own
_TRAVEL_M = [-0.004, 0.124]
_SERIAL: dict[str, tuple[type[BaseModel], dict[str, Any], Callable[..., SerialBench]]] = {
    "zaber_ascii": (ZaberSettings, {"microstep_m": 1e-7, "travel_m": _TRAVEL_M}, benches.zaber),
    "bota_serial": (BotaSettings, {"full_scale_n": 10.0}, benches.bota),
    "ascii_line": (AsciiLineSettings, {"full_scale_n": 10.0}, benches.ascii_line),
    "coil_serial": (
        CoilSettings, {"counts_per_m": 1e6, "newton_per_ampere": 2.0, "max_current_a": 3.0}, benches.coil,
    ),
}  # fmt: skip
_NODES: dict[str, tuple[type[BaseModel], dict[str, Any], Callable[..., CanopenDevice]]] = {
    "cia402": (
        Cia402Settings, {"node_id": 1, "counts_per_m": 1e7, "travel_m": _TRAVEL_M}, can_benches.drive,
    ),
    "cia404": (Cia404Settings, {"node_id": 2, "full_scale_n": 10.0}, can_benches.transducer),
}  # fmt: skip
CAN = *_NODES, "can_hub"
DEVICES = *_SERIAL, *CAN
_LOAD_CELLS = "bota_serial", "ascii_line", "cia404"


@dataclass(frozen=True, slots=True)
class EmulatorOptions:
    """What the user asked for on the command line."""

    device: str
    port: str | None
    config: Path | None
    axis: str | None
    feel: Path | None
    faults: str
    seed: int


def run_emulator(options: EmulatorOptions, duration_s: float | None = None) -> None:
    """Runs until SIGINT, SIGTERM, SIGHUP or the end of the duration; then says what befell the bytes.

    Raises:
        InputError: an unknown device or fault, a file or a place for the port that can not be used.
    """
    if options.device not in DEVICES:
        raise ConfigurationError(f"{options.device!r}: expected one of {', '.join(DEVICES)}")
    die_with_parent()
    prepare_thread(_PRIORITY)  # a microcontroller waits for no other program of this machine
    faults = Faults.parse(options.faults)
    with heeded() as stop, ExitStack() as leave:
        make = _serial if options.device in _SERIAL else _hub if options.device == "can_hub" else _node
        running = make(options, faults, leave)
        orders = OrdersFromStdin(OrderReader(running.living.faults, running.living.provoke, running.load))
        prepare_process()  # nor for its own collector of garbage
        _run(running.living, orders, duration_s, stop)
        with suppress(OSError):  # of a terminal that is gone
            print(json.dumps({"device": options.device, **running.counts()}), flush=True)


def _run(living: "Living", orders: OrdersFromStdin, duration_s: float | None, stop: Stop) -> None:
    end_s = None if duration_s is None else time.monotonic() + duration_s
    while not stop.wanted() and (end_s is None or time.monotonic() < end_s):
        orders.step()
        living.step()


class Living(Protocol):
    """What lives by being stepped, and can be disturbed."""

    @property
    def faults(self) -> Sequence[str]:
        """What `provoke` takes."""
        ...

    def step(self) -> None:
        """A round of about a millisecond."""
        ...

    def provoke(self, fault: str) -> None:
        """Begins a fault now."""
        ...


class Running(NamedTuple):
    """An emulator that is there. `load`: what hangs on it; None: it is no load cell."""

    living: Living
    counts: Callable[[], dict[str, Any]]
    load: Load | None = None


def _serial(options: EmulatorOptions, faults: Faults, leave: ExitStack) -> Running:
    kind, defaults, build = _SERIAL[options.device]
    settings, world = section(options, kind, defaults)
    around = Surroundings(world, options.feel, options.seed)
    bench = build(settings, around, leave)
    faults.require_known(("unplug", "plug", *bench.device.faults))
    port = leave.enter_context(Pty(bench.port))
    server = PtyServer(bench.device, port, bench.baud, faults, options.seed)
    print(f"{options.device} on {bench.port} at {bench.baud} baud", flush=True)

    def counts() -> dict[str, Any]:
        ways = {"from_host": server.to_device, "to_host": server.to_host}
        return {**{way: dict(wire.counts) for way, wire in ways.items()}, "lost": port.lost}

    return Running(server, counts, around.load if options.device in _LOAD_CELLS else None)


def _hub(options: EmulatorOptions, faults: Faults, leave: ExitStack) -> Running:
    if options.port is None:
        raise ConfigurationError("emulate can_hub: expected --port LINK,LINK")
    faults.require_known(CanHub.faults)
    hub = can_benches.hub(options.port, faults, options.seed, leave)
    print(f"can_hub on {options.port}", flush=True)
    return Running(hub, hub.counts)


def _node(options: EmulatorOptions, faults: Faults, leave: ExitStack) -> Running:
    """A CANopen device on `--port` of an slcan hub, or on the bus of the file."""
    kind, defaults, build = _NODES[options.device]
    settings, world = section(options, kind, defaults)
    around = Surroundings(world, options.feel, options.seed)
    device = build(settings, around, leave)
    faults.require_known(device.faults)
    place = f"{settings.can.interface} {settings.can.channel}"
    print(f"{options.device} node {settings.node_id} on {place}", flush=True)
    load = around.load if options.device in _LOAD_CELLS else None
    return Running(_OnTimetable(device, faults), lambda: {"node": settings.node_id}, load)


class _OnTimetable:
    """A CANopen device and what is to happen to it."""

    def __init__(self, device: CanopenDevice, faults: Faults) -> None:
        self._device, self._timetable = device, Timetable(faults)
        self._start_s = time.monotonic()
        self.faults, self.provoke = device.faults, device.provoke

    def step(self) -> None:
        for fault in self._timetable.due(time.monotonic() - self._start_s):
            self.provoke(fault)
        self._device.step()


def section(
    options: EmulatorOptions, kind: type[BaseModel], defaults: dict[str, Any]
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
        place = {"can": _slcan(options.port)} if options.device in _NODES else {"port": options.port}
        given = {"driver": options.device, **place, **defaults}
        return checked(kind, given, f"emulate {options.device}"), preset("catheter")
    daemon = load_daemon(options.config)
    assert isinstance(daemon, SlaveSettings | MasterSettings)
    names = [axis.name for axis in daemon.axes]
    axis = next((axis for axis in daemon.axes if options.axis in (None, axis.name)), None)
    if axis is None:
        raise ConfigurationError(
            f"--axis {options.axis}: expected one of {', '.join(names)}, the axes of {options.config}"
        )
    devices = [device.settings for device in configured(daemon) if device.axis == axis.name]
    found = next((settings for settings in devices if isinstance(settings, kind)), None)
    if found is None:
        raise ConfigurationError(
            f"{options.config}: axis {axis.name} has no driver {options.device!r}; expected one"
        )
    changed = found if options.port is None else found.model_copy(update=_elsewhere(found, options.port))
    world = axis.simulation if hasattr(axis, "simulation") else preset("catheter")
    return changed, world


def _elsewhere(settings: BaseModel, port: str) -> dict[str, Any]:
    can = getattr(settings, "can", None)
    return {"port": port} if can is None else {"can": CanSettings(**_slcan(port), bitrate=can.bitrate)}


def _slcan(port: str) -> dict[str, Any]:
    return {"interface": "slcan", "channel": port}
