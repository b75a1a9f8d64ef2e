"""The drivers beside the raw line: `python -m benchmarks.hardware [--seconds S]`.

Emulated devices speak their byte protocols on pseudo terminals, each in a process of its own. A row is a
link: the share of a core that its reader takes, raw (it looks at no byte) and as driver, and a time: of an
exchange (zaber), of a reading's age (bota), from `render` to the state with that current (coil), from SYNC to
the drive's TPDO (can). Below: 100,000 frames, of which one in a hundred has a wrong byte.
"""

import argparse
import multiprocessing
import os
import random
import select
import threading
import time
import tty
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import sin
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import can

from benchmarks.markdown import Table
from forefeel.common.clock import MonotonicClock
from forefeel.common.hardware.link import DeviceLink, LinkState
from forefeel.common.runtime.realtime import prepare_process, prepare_thread
from forefeel.devices.bota.driver import BotaCell, BotaSerialLoadCell
from forefeel.devices.bota.emulator import EmulatedBota
from forefeel.devices.bota.settings import BotaSettings
from forefeel.devices.canopen.bus import open_bus
from forefeel.devices.canopen.cia301 import HEARTBEAT, NMT, OPERATIONAL, START, SYNC
from forefeel.devices.canopen.hub import CanHub
from forefeel.devices.canopen.network import HOST_NODE, acquire, release
from forefeel.devices.cia402 import protocol as cia402
from forefeel.devices.cia402.driver import Cia402Stage, command_pdo, state_pdo
from forefeel.devices.cia402.emulator import Drive402, DriveModel
from forefeel.devices.cia402.settings import Cia402Settings
from forefeel.devices.cia404.driver import Cia404LoadCell
from forefeel.devices.cia404.emulator import Transducer404
from forefeel.devices.cia404.settings import Cia404Settings
from forefeel.devices.coil.driver import CoilHandle, CoilTalk
from forefeel.devices.coil.emulator import CoilDevice
from forefeel.devices.coil.protocol import PROTOCOL, CoilCommand, Identify, encode
from forefeel.devices.coil.settings import CoilSettings
from forefeel.devices.emulation.pty import Pty, PtyServer
from forefeel.devices.emulation.sensing import EmulatedSensor
from forefeel.devices.shared.conversation import Pacer
from forefeel.devices.shared.settings import CanSettings
from forefeel.devices.zaber.driver import ZaberExchange, ZaberStage
from forefeel.devices.zaber.emulator import ZaberDevice, ZaberModel
from forefeel.devices.zaber.protocol import Parser, lrc
from forefeel.devices.zaber.settings import ZaberSettings
from forefeel.slave.plant.settings import preset
from tests.emulators.damage import DamagedWire, Faults

_FRAMES, _DAMAGED = 100_000, 0.01  # frames, and the share of them with one wrong byte
_PRIORITY = 50  # SCHED_FIFO of the CAN processes, as `realtime.priority` by default
# bit/s: the defaults of the drivers' settings
_ZABER_BAUD, _BOTA_BAUD, _COIL_BAUD = 115_200, 460_800, 500_000
_BOTA_HZ, _CAN_HZ = 800.0, 250  # the defaults of their rates
_DRIVE, _CELL = 5, 6  # CANopen nodes, arbitrary
_STARTS_S = 3.0  # s in which the CAN devices have imported what they need


class Cost(NamedTuple):
    """Share of a core that a reader took, and times in ms, none where it can tell none."""

    cpu: float
    times_ms: list[float]


Cpu = Callable[[], float]


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hardware")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each measurement")
    seconds = parser.parse_args().seconds
    table = Table(
        ["link", "raw, % of a core", "driver", "ratio", "raw p50 / p99, ms", "driver p50 / p99, ms"], ""
    )
    for name, measure in (("zaber", _zaber), ("bota", _bota), ("coil", _coil), ("can", _can)):
        with TemporaryDirectory() as folder:
            raw, driver = measure(Path(folder), seconds)
        shares = f"{100 * raw.cpu:.1f}", f"{100 * driver.cpu:.1f}", f"{driver.cpu / raw.cpu:.1f}"
        table.add([name, *shares, _quantiles(raw.times_ms), _quantiles(driver.times_ms)])
    print()
    table = Table(["frames", "damaged", "lost", "of these intact", "taken for others", "us a frame"], "")
    for damage in _zaber_damage, _bota_damage, _coil_damage:
        table.add(damage())


def _quantiles(times_ms: list[float]) -> str:
    if not times_ms:
        return "-"
    times_ms.sort()
    return " / ".join(f"{times_ms[int(share * (len(times_ms) - 1))]:.2f}" for share in (0.5, 0.99))


def _cost(seconds: float, step: Callable[[], object], cpu_s: Cpu = time.process_time) -> float:
    """Repeats `step` for that time; returns the share of a core that it takes."""
    start_s, start_cpu_s = time.monotonic(), cpu_s()
    while (wall_s := time.monotonic() - start_s) < seconds:
        step()
    return (cpu_s() - start_cpu_s) / wall_s


@contextmanager
def _process(serve: Callable[..., None], *arguments: object) -> Iterator[None]:
    """An emulated device in a process of its own; its first argument is the port, or a list of them."""
    child = multiprocessing.get_context("spawn").Process(target=serve, args=arguments, daemon=True)
    child.start()
    first = arguments[0]
    ports = [port for port in (first if isinstance(first, list) else [first]) if isinstance(port, Path)]
    while not all(port.exists() for port in ports):
        time.sleep(0.01)
    try:
        yield
    finally:
        child.terminate()
        child.join()


def _raw_port(port: Path) -> int:
    number = os.open(port, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(number)
    return number


# --- zaber: an exchange of two questions ---


def _zaber(folder: Path, seconds: float) -> tuple[Cost, Cost]:
    echoing, port = folder / "echo", folder / "stage"
    question, times_ms = b"/1 1 05 move abs 123456:2F\n/1 1 06 get pos:26\n", list[float]()
    with _process(_echo, echoing):
        number = _raw_port(echoing)

        def exchange() -> None:
            start_s, missing = time.monotonic(), len(question)
            os.write(number, question)
            while missing > 0:
                missing -= len(os.read(number, 4096))
            times_ms.append(1e3 * (time.monotonic() - start_s))
            time.sleep(0.01)  # as often as the driver may at 115200 baud

        raw = Cost(_cost(seconds, exchange), times_ms)
        os.close(number)
    with _process(_serve_zaber, port):
        return raw, _zaber_driver(port, seconds)


def _zaber_driver(port: Path, seconds: float) -> Cost:
    """The exchanges of the driver's thread while it follows a setpoint."""
    settings = {"driver": "zaber_ascii", "port": str(port), "microstep_m": 1e-7, "travel_m": (0.0, 0.2)}
    stage = ZaberStage(ZaberSettings.model_validate(settings | {"max_velocity_m_s": 0.05}))
    step, times_ms = ZaberExchange.step, list[float]()

    def timed(exchange: ZaberExchange) -> None:
        start_s = time.monotonic()
        step(exchange)
        times_ms.append(1e3 * (time.monotonic() - start_s))

    stage.open()
    start_s = time.monotonic()

    def command() -> None:
        stage.command(0.005 * (time.monotonic() - start_s), 0.005, time.monotonic_ns())
        time.sleep(0.05)  # the control loop is not what is measured

    try:
        ZaberExchange.step = timed  # type: ignore[method-assign, assignment]
        return Cost(_cost(seconds, command), times_ms)
    finally:
        ZaberExchange.step = step  # type: ignore[method-assign]
        stage.close()


def _echo(port: Path) -> None:
    pty = Pty(port)
    while True:
        pty.write(pty.read(1.0))


def _serve_zaber(port: Path) -> None:
    server = PtyServer(ZaberDevice(ZaberModel(limits_m=(0.0, 0.2))), Pty(port), _ZABER_BAUD)
    while True:
        server.step()


def _zaber_damage() -> list[object]:
    chosen = random.Random(1)
    frames = [b"01 1 %02d OK BUSY -- %d" % (number % 100, number) for number in range(_FRAMES)]
    frames = [b"@%s:%02X\r\n" % (body, lrc(body)) for body in frames]
    damaged = {number for number in range(_FRAMES) if chosen.random() < _DAMAGED}
    stream = bytearray()
    for number, frame in enumerate(frames):
        hurt = bytearray(frame)
        if number in damaged:
            hurt[chosen.randrange(len(frame))] ^= chosen.randrange(1, 256)
        stream += hurt
    wanted = {Parser().feed(frame)[0] for frame in frames}
    parser, start_s = Parser(), time.perf_counter()
    replies = [
        reply for at in range(0, len(stream), 64) for reply in parser.feed(bytes(stream[at : at + 64]))
    ]
    took_us = 1e6 * (time.perf_counter() - start_s) / _FRAMES
    lost = set(range(_FRAMES)) - {int(reply.data) for reply in replies if reply in wanted}
    wrong = sum(reply not in wanted for reply in replies)
    return ["zaber", len(damaged), len(lost), len(lost - damaged), wrong, f"{took_us:.1f}"]


# --- bota: a reading's age ---


def _bota_settings(port: Path) -> BotaSettings:
    given = {"driver": "bota_serial", "port": str(port), "full_scale_n": 10, "rate_hz": _BOTA_HZ}
    return BotaSettings.model_validate(given | {"baud": _BOTA_BAUD})


def _serve_bota(port: Path) -> None:
    server = PtyServer(EmulatedBota(EmulatedSensor(sin, _BOTA_HZ)), Pty(port), _BOTA_BAUD)
    while True:
        server.step()


def _bota(folder: Path, seconds: float) -> tuple[Cost, Cost]:
    port, ages_ms = folder / "cell", list[float]()
    with _process(_serve_bota, port):
        number = _raw_port(port)

        def receive() -> None:
            select.select([number], [], [], 0.02)
            os.read(number, 4096)

        raw = Cost(_cost(seconds, receive), [])
        os.close(number)
        driver = BotaSerialLoadCell(_bota_settings(port))
        driver.open()
        (thread,) = (thread for thread in threading.enumerate() if thread.name == driver.link.name)
        clock = time.pthread_getcpuclockid(thread.ident or 0)

        def read() -> None:
            time.sleep(0.001)
            now_ns = time.monotonic_ns()
            ages_ms.extend(
                (now_ns - one.stamp_ns) * 1e-6 for one in driver.read(now_ns, None) if one.stamp_ns
            )

        # of its own thread: what the 1 kHz loop takes is little, and the same for every driver
        share = _cost(seconds, read, lambda: time.clock_gettime(clock))
        driver.close()
    return raw, Cost(share, ages_ms)


def _bota_damage() -> list[object]:
    """The driver without its thread, in virtual time."""
    device, counters = EmulatedBota(EmulatedSensor(sin, _BOTA_HZ)), Counter[str]()
    wire = DamagedWire(_BOTA_BAUD, Faults(corrupt=_DAMAGED), "out 0")
    cell, measured, spent_s = BotaCell(_bota_settings(Path("cell")), counters), 0, 0.0
    for frame in range(_FRAMES + 1):  # one more call delivers what is under way
        t_s = (frame + 1) / _BOTA_HZ
        arrived = wire.arrived(t_s)
        start_s = time.perf_counter()
        measured += len(cell.take(arrived, round(t_s * 1e9)))
        spent_s += time.perf_counter() - start_s
        if frame < _FRAMES:
            wire.send(device.advance(t_s), t_s)
    damaged, lost = wire.counts["corrupted"], _FRAMES - measured
    return ["bota", damaged, lost, lost - damaged, 0, f"{1e6 * spent_s / _FRAMES:.1f}"]


# --- coil: from a force to the state that has its current ---


def _coil_settings(port: Path) -> CoilSettings:
    given = {"driver": "coil_serial", "port": str(port), "counts_per_m": 1e6, "newton_per_ampere": 2.0}
    return CoilSettings.model_validate(given | {"baud": _COIL_BAUD, "max_current_a": 3.0, "watchdog_s": 0.1})


def _serve_coil(port: Path) -> None:
    server = PtyServer(CoilDevice(), Pty(port), _COIL_BAUD)
    while True:
        server.step()


def _coil(folder: Path, seconds: float) -> tuple[Cost, Cost]:
    port, command = folder / "handle", encode(CoilCommand(1, 0, None, None, False))
    with _process(_serve_coil, port):
        number = _raw_port(port)
        os.write(number, encode(Identify(PROTOCOL, 100, 3000)))

        def answer() -> None:
            """Answers each state with the same bytes, and looks at none."""
            if select.select([number], [], [], 0.1)[0] and os.read(number, 4096):
                os.write(number, command)

        raw = Cost(_cost(seconds, answer), [])
        os.close(number)
    port.unlink(missing_ok=True)
    with _process(_serve_coil, port):
        handle, times_ms = CoilHandle(_coil_settings(port), MonotonicClock()), list[float]()
        handle.open()
        try:
            handle.render(0.0, 0)
            share = _cost(seconds, lambda: time.sleep(0.1))
            _cost(seconds, lambda: times_ms.append(_round_trip_ms(handle, 100 + len(times_ms) % 2)))
        finally:
            handle.close()
    return raw, Cost(share, times_ms)


def _round_trip_ms(handle: CoilHandle, current_ma: int) -> float:
    time.sleep(random.uniform(0.001, 0.003))
    start_ns = time.monotonic_ns()
    handle.render(current_ma * 2e-3, start_ns)
    while (newest := handle._talk.newest) is None or newest.state.current_ma != current_ma:
        time.sleep(50e-6)
        handle.render(current_ma * 2e-3, time.monotonic_ns())
    return (newest.arrived_ns - start_ns) * 1e-6


def _coil_damage() -> list[object]:
    """The exchange in virtual time; damaged are the states to the host and the commands to the device."""
    device, link, spent_s = CoilDevice(), DeviceLink("handle"), 0.0
    talk, faults = CoilTalk(_coil_settings(Path("memory")), link), Faults(corrupt=_DAMAGED)
    clean = DamagedWire(_COIL_BAUD, Faults())
    out, back = DamagedWire(_COIL_BAUD, faults, "out"), DamagedWire(_COIL_BAUD, faults, "in")
    link.advance(LinkState.OPEN)
    question, tick = talk.begin(0), 0
    while link.counters["frames"] + link.counters["frames_lost"] < _FRAMES:
        tick += 1
        t_s = tick * 1e-3
        to_host, to_device = (out, back) if talk.settled else (clean, clean)
        to_device.send(question, t_s)
        device.receive(to_device.arrived(t_s + 0.5e-3), t_s)
        to_host.send(device.advance(t_s), t_s)
        arrived, start_s = to_host.arrived(t_s + 0.9e-3), time.perf_counter()
        question = talk.hear(arrived, round((t_s + 0.9e-3) * 1e9))
        spent_s += time.perf_counter() - start_s
    damaged = out.counts["corrupted"] + back.counts["corrupted"]
    lost = link.counters["frames_lost"] + device.counters["commands_lost"]
    return ["coil, both ways", damaged, lost, lost - damaged, 0, f"{1e6 * spent_s / _FRAMES:.1f}"]


# --- can: from SYNC to the drive's TPDO ---


class _RoundTrips:
    """Times from SYNC to the drive's TPDO, at the host."""

    def __init__(self) -> None:
        self.times_ms: list[float] = []
        self._sent_ns = 0

    def sync(self) -> None:
        """To be called before SYNC is sent."""
        self._sent_ns = time.monotonic_ns()

    def answer(self, *_frame: object) -> None:
        """To be called when the TPDO is there."""
        if self._sent_ns:
            self.times_ms.append((time.monotonic_ns() - self._sent_ns) * 1e-6)
            self._sent_ns = 0


def _serve_hub(ports: list[Path]) -> None:
    _prepare()
    hub = CanHub(ports)
    while True:
        hub.step()


def _serve_can(port: str, node: int) -> None:
    _prepare()
    bus, model = open_bus(_can_settings(port)), DriveModel(preset("catheter").stage, 1e6, rate_hz=1000)
    drive = node == _DRIVE
    device = Drive402(bus, node, model) if drive else Transducer404(bus, node, EmulatedSensor(sin, 1000.0))
    while True:
        device.step()


def _prepare() -> None:
    """As every daemon does; threads that begin later have the priority, too."""
    prepare_process()
    prepare_thread(_PRIORITY)


def _can_settings(port: str) -> CanSettings:
    return CanSettings(interface="slcan", channel=port)


def _can(folder: Path, seconds: float) -> tuple[Cost, Cost]:
    ports = [folder / name for name in ("host", "drive", "cell")]
    host, drive, cell = map(str, ports)
    _prepare()
    with _process(_serve_hub, ports), _process(_serve_can, drive, _DRIVE), _process(_serve_can, cell, _CELL):
        time.sleep(_STARTS_S)
        driver = _can_driver(_can_settings(host), seconds)
        return _can_raw(_can_settings(host), seconds), driver


def _can_driver(bus: CanSettings, seconds: float) -> Cost:
    """The slave's control loop at 1 kHz, as far as these devices see it."""
    trips, shared, clock = _RoundTrips(), acquire(bus), MonotonicClock()
    send, travel = shared.send, preset("catheter").stage

    def stamped(can_id: int, data: bytes) -> None:
        if can_id == SYNC:
            trips.sync()
        send(can_id, data)

    shared.send = stamped  # type: ignore[method-assign]
    shared.subscribe(state_pdo(_DRIVE).can_id, trips.answer)
    stage = Cia402Stage(
        Cia402Settings(
            driver="cia402", can=bus, node_id=_DRIVE, counts_per_m=1e6, sync_hz=_CAN_HZ, heartbeat_s=0.1,
            travel_m=(travel.travel_lower_m, travel.travel_upper_m),
        )
    )  # fmt: skip
    cell = Cia404LoadCell(
        Cia404Settings(driver="cia404", can=bus, node_id=_CELL, full_scale_n=10.0, rate_hz=_CAN_HZ)
    )
    try:
        stage.open()
        cell.open()
        home_m, pacer = stage.read(clock.now_ns()).position_m, Pacer(clock, 1_000_000)
        trips.times_ms.clear()

        def tick() -> None:
            now_ns = clock.now_ns()
            stage.read(now_ns)
            stage.command(home_m, 0.0, now_ns)
            cell.read(now_ns, None)
            time.sleep(pacer.wait_s())

        return Cost(_cost(seconds, tick), trips.times_ms)
    finally:
        stage.close()
        cell.close()
        release(shared)


def _can_raw(settings: CanSettings, seconds: float) -> Cost:
    """The same frames through python-can alone, to the devices that the drivers have configured."""
    bus, trips, stopping = open_bus(settings), _RoundTrips(), threading.Event()
    answer_id, command = state_pdo(_DRIVE).can_id, command_pdo(_DRIVE)

    def receive() -> None:
        while not stopping.is_set():
            message = bus.recv(0.05)
            if message is not None and message.arbitration_id == answer_id:
                trips.answer()

    def send(can_id: int, data: bytes) -> None:
        bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    receiver = threading.Thread(target=receive)
    receiver.start()
    send(NMT, bytes([START, 0]))
    time.sleep(0.1)
    pacer = Pacer(MonotonicClock(), round(1e9 / _CAN_HZ))

    def cycle() -> None:
        send(command.can_id, command.pack(cia402.QUICK_STOP, 0))
        trips.sync()
        send(SYNC, b"")
        send(HEARTBEAT + HOST_NODE, bytes([OPERATIONAL]))
        time.sleep(pacer.wait_s())

    share = _cost(seconds, cycle)
    stopping.set()
    receiver.join()
    bus.shutdown()
    return Cost(share, trips.times_ms)


if __name__ == "__main__":
    main()
